"""Redundant instruments: where their axes point, how well they measure, and what they say of each other.

A `Cluster` is any number of instruments of one, two or three axes that measure the same vector x (a rate, a specific
force): m = H x + e, with the axes as the rows of H (axes, 3). What is needed at every epoch is worked out once, here:
the least-squares gain for every choice of instruments, and the parity matrix V.

Sources: H.S. Kim et al., Hybrid fault detection and isolation method for UAV inertial sensor redundancy management
system (2005), equations (1)-(30); J.E. Potter and J.C. Deckert, J. Spacecraft 10 (1973), for V.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import null_space, subspace_angles

from ftcore.detection.result import Array, Ints, Mask

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """Instruments with fixed axes. Make one with `cluster` or `three_two_dof`; all arrays are read-only."""

    H: Array
    """Unit input axes, (axes, 3)."""
    instrument: Ints
    """Which instrument each axis belongs to, (axes,): 0 to count - 1."""
    V: Array
    """Parity matrix, (axes - 3, axes): V H = 0, V V' = I."""
    gains: Array
    """Least-squares gain for every choice of instruments, (2^count, 3, axes); bit k of the index is instrument k."""
    covariances: Array
    """(H' H)^-1 over the chosen instruments, (2^count, 3, 3): covariance of the solution for axes of unit variance."""
    observable: Mask
    """Whether the chosen instruments see all three directions, (2^count,)."""

    @property
    def count(self) -> int:
        """How many instruments."""
        return int(self.gains.shape[0]).bit_length() - 1

    @property
    def axes(self) -> int:
        """How many axes, all instruments together."""
        return int(self.H.shape[0])


def cluster(instruments: Sequence[ArrayLike]) -> Cluster:
    """A cluster of instruments, each given by its input axes: (3,) or (1, 3), (2, 3), (3, 3); any length, made unit.

    Raises ValueError when an axis has no direction, when the axes of one instrument are not perpendicular (within
    1e-9), when together they do not see all three directions, or when there is nothing redundant (three axes or fewer).
    """
    axes = [np.atleast_2d(np.asarray(a, dtype=float)) for a in instruments]
    for k, a in enumerate(axes):
        if a.ndim != 2 or a.shape[1] != 3 or not 1 <= a.shape[0] <= 3:
            raise ValueError(f"instrument {k + 1} needs one to three axes of three components; got shape {a.shape}")
        length = np.linalg.norm(a, axis=1, keepdims=True)
        if not (np.isfinite(length) & (length > 0.0)).all():
            raise ValueError(f"instrument {k + 1} has an axis without a direction: {a.tolist()}")
        axes[k] = a = a / length
        if np.abs(a @ a.T - np.eye(len(a))).max() > _ROUNDING:
            raise ValueError(f"the axes of instrument {k + 1} must be perpendicular to each other: {a.tolist()}")
    H = np.concatenate(axes) if axes else np.zeros((0, 3))
    if H.shape[0] <= 3:
        raise ValueError(f"{H.shape[0]} axes measure three directions without redundancy: at least 4 are needed")
    if np.linalg.matrix_rank(H, tol=_ROUNDING) < 3:
        raise ValueError("the axes lie in one plane: a direction is not measured at all")
    instrument = np.repeat(np.arange(len(axes)), [len(a) for a in axes])

    chosen = np.arange(2 ** len(axes))[:, None] >> np.arange(len(axes)) & 1
    weighted = H * chosen[:, instrument, None]  # (2^count, axes, 3)
    covariances = np.linalg.pinv(weighted.swapaxes(-1, -2) @ weighted, rcond=_ROUNDING, hermitian=True)
    gains = covariances @ weighted.swapaxes(-1, -2)
    observable = np.linalg.matrix_rank(weighted, tol=np.sqrt(_ROUNDING)) == 3
    made = Cluster(H, instrument, parity_matrix(H), gains, covariances, np.asarray(observable))
    for array in (made.H, made.instrument, made.V, made.gains, made.covariances, made.observable):
        array.flags.writeable = False
    return made


def input_axes(phi: ArrayLike, theta: ArrayLike, psi: ArrayLike) -> Array:
    """Measurement matrix of three 2-DOF instruments with spin axes z, y and x, (..., 6, 3), angles in rad.

    Source: (26)-(27).
    """
    phi, theta, psi = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in (phi, theta, psi)))
    zero = np.zeros_like(phi)
    rows = (
        (np.cos(phi), np.sin(phi), zero),
        (-np.sin(phi), np.cos(phi), zero),
        (np.sin(theta), zero, np.cos(theta)),
        (-np.cos(theta), zero, np.sin(theta)),
        (zero, np.cos(psi), np.sin(psi)),
        (zero, -np.sin(psi), np.cos(psi)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def three_two_dof(phi: float = np.pi / 4, theta: float = np.pi / 4, psi: float = np.pi / 4) -> Cluster:
    """Three 2-DOF instruments turned by phi, theta, psi [rad] about their spin axes z, y, x; the optimum by default.

    Source: (26)-(28).
    """
    H = input_axes(phi, theta, psi)
    return cluster([H[0:2], H[2:4], H[4:6]])


def gnc_index(H: Array) -> Array:
    """Navigation index J_GNC = sqrt |(H'H)^-1| of measurement matrices (..., axes, 3); small is good. Source: (7)."""
    return np.asarray(1.0 / np.sqrt(np.linalg.det(H.swapaxes(-1, -2) @ H)))


def isolability(H: Array) -> Array:
    """F_i of every axis, (..., axes), of measurement matrices (..., axes, 3): how much more its own parity equation
    feels an axis than the axis it feels next: J_ii / max J_ij, j != i. 0 for an axis without redundancy.

    The parity equation (13) of axis i is row i of the residual projector M = I - H (H'H)^-1 H' divided by M_ii, so
    (14) becomes J_ij = M_ij^2 / M_ii. Source: (12)-(15).
    """
    m = H.shape[-2]
    Ht = H.swapaxes(-1, -2)
    M = np.eye(m) - H @ np.linalg.inv(Ht @ H) @ Ht
    own = np.square(np.diagonal(M, axis1=-2, axis2=-1))
    other = np.square(np.where(np.eye(m, dtype=bool), 0.0, M)).max(axis=-1)
    return np.asarray(np.where(own > _ROUNDING**2, own / np.maximum(other, _ROUNDING**2), 0.0))


def fdi_index(H: Array) -> Array:
    """Isolation index J_FDI, the least F_i, (...): larger is better. Source: (16)."""
    return np.asarray(isolability(H).min(axis=-1))


def best_angles(step: float = np.pi / 60, refinements: int = 6) -> tuple[Array, float]:
    """The angles (phi, theta, psi) [rad] of three 2-DOF instruments with the largest J_FDI, and that index.

    A grid over a quarter turn of each (a quarter turn more only renames axes), then finer grids about the best. Ties go
    to the smallest angles. Source: the search behind (28), which the paper does by gradients.
    """
    if not 0.0 < step <= np.pi / 8:
        raise ValueError(f"the first grid's step must lie between 0 and pi/8 rad, not {step}")
    grid = np.arange(0.0, np.pi / 2 - _ROUNDING, step)
    best = _best_of(np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3))
    around = np.linspace(-1.0, 1.0, 9)
    offsets = np.stack(np.meshgrid(around, around, around, indexing="ij"), axis=-1).reshape(-1, 3)
    for _ in range(refinements):
        best = _best_of(np.concatenate([best[0][None], best[0] + step * offsets]))
        step /= 4.0
    return best


def improve_angles(starts: ArrayLike, steps: int = 40) -> tuple[Array, Array]:
    """Angles (phi, theta, psi) [rad] that a search uphill from each of `starts` (n, 3) ends at, and their J_FDI (n,).

    A compass search: to the best of the 26 neighbours of a cube about the present angles; where none is better the cube
    shrinks to half. J_FDI has ridges, on which gradients lead nowhere. Source: the optimisation behind (28).
    """
    angles = np.array(starts, dtype=float, ndmin=2)
    index = fdi_index(input_axes(*angles.T))
    size = np.full(len(angles), np.pi / 12)
    around = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    every = np.arange(len(angles))
    for _ in range(steps):
        tried = angles[:, None] + size[:, None, None] * around
        found = fdi_index(input_axes(*np.moveaxis(tried, -1, 0)))
        best = found.argmax(axis=1)
        better = found[every, best] > index + _ROUNDING
        angles = np.where(better[:, None], tried[every, best], angles)
        index = np.where(better, found[every, best], index)
        size = np.where(better, size, 0.5 * size)
    return angles, index


@dataclass(frozen=True, slots=True, eq=False)
class SingularFault:
    """A line that the fault planes of two instruments share: on it one's fault looks like the other's."""

    instruments: tuple[int, int]
    """The two, counted from 0."""
    line: Array
    """Its unit direction in parity space, (axes - 3,)."""
    faults: tuple[Array, Array]
    """Unit fault of each instrument, by its own input axes, that moves p along the line."""


def singular_faults(instruments: Cluster) -> tuple[SingularFault, ...]:
    """All lines on which the fault planes of two instruments meet, in the order of the pairs.

    Two planes of a three-dimensional parity space meet in one line at least; in larger ones they may not meet at all.
    Source: section 4.1 of Kim et al.
    """
    found = []
    columns = [instruments.V[:, instruments.instrument == k] for k in range(instruments.count)]
    for a in range(instruments.count):
        for b in range(a + 1, instruments.count):
            pair = np.concatenate([columns[a], -columns[b]], axis=1)
            for both in null_space(pair, rcond=_ROUNDING).T:
                split = columns[a].shape[1]
                line = columns[a] @ both[:split]
                length = np.linalg.norm(line)
                if length > _ROUNDING:
                    sign = np.sign(both[np.abs(both[:split]).argmax()])
                    faults = (_unit(sign * both[:split]), _unit(sign * both[split:]))
                    found.append(SingularFault((a, b), sign * line / length, faults))
    return tuple(found)


def plane_angles(instruments: Cluster) -> Array:
    """Angle [rad], 0 to pi/2, between the fault planes of every two instruments, (pairs,) in the order of the pairs.

    Of planes in more than three dimensions the largest principal angle.
    """
    columns = [instruments.V[:, instruments.instrument == k] for k in range(instruments.count)]
    return np.array([subspace_angles(a, b).max() for a, b in combinations(columns, 2)])


def parity_matrix(H: Array) -> Array:
    """The parity matrix V (axes - 3, axes) with V H = 0 and V V' = I, of a measurement matrix (axes, 3).

    These conditions leave V free up to a rotation. The one taken is upper trapezoidal with a positive first entry in
    every row: Potter and Deckert's, the same on every machine. Source: (29).
    """
    rank = H.shape[1]
    basis = np.linalg.svd(H)[0][:, rank:]
    V = np.asarray(np.linalg.qr(basis.T)[1])
    V[np.abs(V) < _ROUNDING] = 0.0
    first = (V != 0.0).argmax(axis=1)
    return np.asarray(V * np.sign(np.take_along_axis(V, first[:, None], axis=1)))


def mask_index(used: Mask) -> Ints:
    """Index into a cluster's tables for the instruments used, (..., count) to (...)."""
    return np.asarray(used @ (1 << np.arange(used.shape[-1])))


def solve(instruments: Cluster, readings: Array, used: Mask) -> Array:
    """The measured vector from the readings of the instruments used, by least squares.

    Shapes: readings (runs, axes) or (runs, samples, axes), in any unit; used (runs or 1, count). Returns (runs, 3) or
    (runs, samples, 3). Readings of instruments not used do not enter, but must be finite. Where the used instruments
    do not see all directions (`Cluster.observable`), the unseen part is 0: the solution of least length. Source: (2).
    """
    gain = instruments.gains[mask_index(used)]
    return np.asarray(np.matvec(gain if readings.ndim == 2 else gain[:, None], readings))


def solution_covariance(instruments: Cluster, used: Mask, sigma: float = 1.0) -> Array:
    """Covariance of `solve` for axes of standard deviation `sigma`, (runs, 3, 3). Source: (3).

    Where a direction is not seen its variance is given as 0, the error of the 0 that `solve` puts there being unknown.
    """
    return np.asarray(sigma**2 * instruments.covariances[mask_index(used)])


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def _best_of(angles: NDArray[np.float64]) -> tuple[Array, float]:
    index = fdi_index(input_axes(*angles.T))
    # Rounding must not choose among equals.
    best = int((index > index.max() - _ROUNDING).argmax())
    return angles[best], float(index[best])
