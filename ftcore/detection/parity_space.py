"""Parity space of redundant instruments: where their faults show, and what a healthy cluster shows there.

The parity vector p = V m does not contain what the instruments measure, only how they disagree: noise, bias, faults.
A fault of one instrument moves p within the span of the columns of V that belong to its axes: its fault plane.

A `Reference` holds the covariance C of p for a healthy cluster, and projections out of the planes of every choice of
instruments. C must hold all that differs between healthy axes: noise, and either the repeatability of their biases or,
after a calibration, what is left of it. Without that a healthy instrument alarms forever. Where what is left depends on
the motion (scale factors), mean and covariance are those of the moment: `momentary`.

Shapes lead with runs: readings (runs, axes), used (runs, count). Source: H.S. Kim et al. (2005), (29)-(30) and 4.1.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ftcore.detection.geometry import Cluster, mask_index
from ftcore.detection.result import Array, Ints, Mask
from ftcore.estimation.kalman import cholesky, symmetric, triangular_inverse

_NOTHING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """A cluster's parity space, with what a healthy cluster shows in it. Made by `uncalibrated`, `calibrate` or
    `momentary`.

    Tables run over all sets of instruments left out, 2^count of them: bit k of the index is instrument k. After
    `momentary` whatever depends on C has a leading axis of runs.
    """

    cluster: Cluster
    bias: Array
    """Parity vector of the healthy cluster, (runs or 1, r), r = axes - 3."""
    covariance: Array
    """C of p - bias, (r, r)."""
    whitener: Array
    """C^-1/2, (r, r), lower triangular."""
    whitened_axes: Array
    """Columns of V, whitened, as rows: (axes, r)."""
    outside: Array
    """Projections of a whitened parity vector out of the planes of those left out, (2^count, r, r)."""
    plain_outside: Array
    """The same for p itself, for angles."""
    dof: Ints
    """Dimensions that are left, (2^count,)."""
    sensitivity: Array
    """Standard deviations by which a fault of one unit moves what is left of p, for every axis, (2^count, axes)."""

    def outside_of(self, out: Ints) -> Array:
        """Projections out of the planes of the sets `out` (runs or 1, ...), (runs or 1, ..., r, r)."""
        return _entries(self.outside, out, self.outside.ndim == 4)

    def sensitivity_without(self, out: Ints) -> Array:
        """Sensitivities with the sets `out` (runs or 1, ...) left out, (runs or 1, ..., axes)."""
        return _entries(self.sensitivity, out, self.sensitivity.ndim == 3)


def uncalibrated(cluster: Cluster, noise: ArrayLike, repeatability: ArrayLike) -> Reference:
    """What to expect of p when the axes' biases are known only by their spread from switch-on to switch-on.

    `noise`: standard deviation of one reading as it will be tested; `repeatability`: of an axis' bias; one number, or
    one an axis, in the readings' unit. Raises ValueError when one is negative, when both are zero, or when an axis has
    no redundancy.
    """
    variance = _variance(cluster, noise, "noise") + _variance(cluster, repeatability, "repeatability")
    return _reference(cluster, np.zeros((1, cluster.V.shape[0])), variance)


def calibrate(
    cluster: Cluster, readings: Array, noise: ArrayLike, calibration_noise: ArrayLike, stability: ArrayLike = 0.0
) -> Reference:
    """What to expect of p after its bias was averaged from readings of the healthy cluster.

    `readings` (runs, samples, axes), moving or not: p does not contain the motion. `noise`: standard deviation of one
    reading as it will be tested; `calibration_noise`: of one of these readings, white; `stability`: how far an axis'
    bias may wander until it is tested; each one number or one an axis. The covariance is V diag(noise^2 + stability^2
    + calibration_noise^2 / samples) V': the calibration's own error stays in p for good. Errors as in `uncalibrated`.
    """
    if readings.ndim != 3 or readings.shape[2] != cluster.axes or readings.shape[1] < 1:
        raise ValueError(f"calibration takes readings (runs, samples, {cluster.axes} axes); got {readings.shape}")
    variance = (
        _variance(cluster, noise, "noise")
        + _variance(cluster, stability, "stability")
        + _variance(cluster, calibration_noise, "calibration noise") / readings.shape[1]
    )
    return _reference(cluster, np.matvec(cluster.V, readings.mean(axis=1)), variance)


def momentary(reference: Reference, bias: Array, covariance: Array) -> Reference:
    """The same cluster where mean and covariance of p differ from run to run, and from one moment to the next.

    `bias` (runs, r) and `covariance` (runs, r, r) of a healthy cluster's p at this moment. Raises LinAlgError for a
    covariance that is not positive definite.
    """
    cluster = reference.cluster
    whitener = triangular_inverse(cholesky(covariance))
    axes = np.ascontiguousarray((whitener @ cluster.V).swapaxes(-1, -2))
    outside, _ = _outside(cluster, axes)
    sensitivity = np.linalg.norm(axes[:, None] @ outside, axis=-1)
    sensitivity = np.where(reference.sensitivity > 0.0, sensitivity, 0.0)
    return replace(
        reference,
        bias=bias,
        covariance=covariance,
        whitener=whitener,
        whitened_axes=axes,
        outside=outside,
        sensitivity=sensitivity,
    )


def parity_vector(reference: Reference, readings: Array) -> Array:
    """p = V m less its calibrated bias, (runs, r), of readings (runs, axes). Source: (30)."""
    return np.asarray(np.matvec(reference.cluster.V, readings) - reference.bias)


def fault_angles(reference: Reference, p: Array, used: Mask | None = None) -> Array:
    """FI_k: angle [rad] between parity vectors (runs, r) and every instrument's fault plane, (runs, count).

    pi/2 for p = 0, which points at nobody. Source: section 4.1 of Kim et al.
    """
    out = np.zeros(1, dtype=np.int64) if used is None else mask_index(~used)
    return angles_outside(reference, np.matvec(reference.plain_outside[out], p), out[:, None] | bits(reference))


def fault_sizes(reference: Reference, p: Array) -> Array:
    """Most likely fault of every axis, were it the only one at fault, (runs, axes), in the readings' unit.

    Divided by its own standard deviation, 1 / sensitivity, it is the residual along Jin and Zhang's optimal parity
    vector C^-1 v_j: of all combinations of parity equations the one that shows this axis best above what C allows. The
    square of that is DF_j.
    """
    along = np.matvec(reference.whitened_axes, np.matvec(reference.whitener, p))
    return np.asarray(along / np.square(reference.sensitivity_without(np.zeros(1, dtype=np.int64))))


def angles_outside(reference: Reference, p: Array, without: Ints) -> Array:
    """FI (runs, count) of parity vectors p (runs, r), given what was left out of p and each instrument besides."""
    away = np.matvec(reference.plain_outside[without], p[:, None])
    square = np.vecdot(p, p)[:, None]
    outside = np.vecdot(away, away)
    sine_squared = np.divide(outside, square, out=np.ones_like(outside), where=square > 0.0)
    return np.asarray(np.arcsin(np.sqrt(np.minimum(sine_squared, 1.0))))


def bits(reference: Reference) -> Ints:
    """The bit of each instrument in an index of choices, (count,)."""
    return 1 << np.arange(reference.cluster.count)


def _reference(cluster: Cluster, bias: Array, variance: Array) -> Reference:
    if not (variance > 0.0).all():
        raise ValueError("noise, repeatability and stability are all zero for some axis: nothing to test against")
    V = cluster.V
    C = symmetric((V * variance) @ V.T)
    whitener = triangular_inverse(cholesky(C))
    axes = np.ascontiguousarray((whitener @ V).T)
    outside, dof = _outside(cluster, axes)
    sensitivity = np.linalg.norm(axes @ outside, axis=-1)
    blind = sensitivity <= _NOTHING * sensitivity.max()
    if blind[0].any():
        raise ValueError(
            f"axes {(np.flatnonzero(blind[0]) + 1).tolist()} have no redundancy: parity cannot see them fail"
        )
    made = Reference(
        cluster, bias, C, whitener, axes, outside, _outside(cluster, V.T)[0], dof, np.where(blind, 0.0, sensitivity)
    )
    for array in (bias, C, whitener, axes, outside, made.plain_outside, dof, made.sensitivity):
        array.flags.writeable = False
    return made


def _outside(cluster: Cluster, axes: Array) -> tuple[Array, Ints]:
    """Projections out of the span of the rows of `axes` (..., axes, r) of every set of instruments, (..., 2^count, r,
    r), and the dimensions that are left, (..., 2^count)."""
    sets = np.arange(2**cluster.count)[:, None] >> np.arange(cluster.count) & 1
    rows = axes[..., None, :, :] * sets[:, cluster.instrument, None]
    _, size, basis = np.linalg.svd(rows, full_matrices=False)
    spanned = size > _NOTHING * np.abs(axes).max(axis=(-1, -2))[..., None, None]
    basis = basis * spanned[..., None]
    r = axes.shape[-1]
    return np.eye(r) - basis.swapaxes(-1, -2) @ basis, np.asarray(r - spanned.sum(axis=-1))


def _entries(table: Array, index: Ints, of_runs: bool) -> Array:
    """Entries of a table over sets, which each run has its own of, or all have in common."""
    if not of_runs:
        return np.asarray(table[index])
    rows = np.arange(len(table)).reshape(-1, *[1] * (index.ndim - 1))
    return np.asarray(table[rows, index])


def _variance(cluster: Cluster, sigma: ArrayLike, what: str) -> Array:
    s = np.broadcast_to(np.asarray(sigma, dtype=float), (cluster.axes,))
    if not (np.isfinite(s) & (s >= 0.0)).all():
        raise ValueError(f"{what} must be a standard deviation of zero or more for each axis; got {s.tolist()}")
    return np.asarray(np.square(s))
