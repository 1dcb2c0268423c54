"""Tests of redundant instruments against each other, in parity space.

The parity vector p = V m does not contain what the instruments measure, only how they disagree: noise, bias, faults.
A fault of one instrument moves p within the span of the columns of V that belong to its axes: its fault plane.

Statistics are formed with the covariance C of p, that is with p and V whitened by C^-1/2; for C = sigma^2 I they are
the papers' own divided by sigma^2, and thresholds are quantiles of chi-square. C must hold all that differs between
healthy axes: noise, and either the repeatability of their biases or, after a calibration, what is left of it. Without
that a healthy instrument alarms forever.

    FD        p' C^-1 p, chi-square on dim p                                large when there is a fault, somewhere
    parity    the part of p outside the plane of instrument k, chi-square   small when k alone is at fault
    angle     between p and the plane of instrument k [rad]                 small when k alone is at fault
    GLT       DF_j, the part of p along v_j, chi-square on 1                largest for the faulty axis
    optimal   the part of p inside the plane of instrument k, chi-square    large when k is at fault

Instruments that are not used (isolated, or without a reading) drop out: p is projected out of their planes, where their
readings have no part in it, and what is left judges the others on fewer degrees of freedom. With one of three 2-DOF
instruments out, one is left: another fault is still seen, but cannot be placed.

Shapes lead with runs: readings (runs, axes), used (runs, count). Sources: H.S. Kim et al. (2005), (29)-(32); H.G. Zhang
and H.Y. Zhang, Fault management for redundant sensor configurations (1990), for the GLT, after K.C. Daly, E. Gai and
J.V. Harrison, Generalized likelihood test for FDI in redundant sensor configurations, J. Guidance 2 (1979); H. Jin and
H.Y. Zhang, Optimal parity vector sensitive to designated sensor fault, IEEE Trans. AES 35 (1999).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftcore.detection.chi_square import decide, threshold
from ftcore.detection.geometry import Cluster, mask_index
from ftcore.detection.result import Array, Ints, Mask, TestResult
from ftcore.estimation.kalman import cholesky, symmetric, triangular_inverse

ANGLE_THRESHOLD = float(np.deg2rad(15.0))
"""Default T_i. At 10 degrees noise leaves one in seven of the paper's faults with a single or a wrong declaration."""

Band = tuple[float, float, int]
"""Faults between two directions [rad] look like those of another instrument."""

_NOTHING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """A cluster's parity space, with what a healthy cluster shows in it. Made by `uncalibrated` or `calibrate`.

    Tables run over all sets of instruments left out, 2^count of them: bit k of the index is instrument k.
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


def parity_vector(reference: Reference, readings: Array) -> Array:
    """p = V m less its calibrated bias, (runs, r), of readings (runs, axes). Source: (30)."""
    return np.asarray(np.matvec(reference.cluster.V, readings) - reference.bias)


def fault_angles(reference: Reference, p: Array, used: Mask | None = None) -> Array:
    """FI_k: angle [rad] between parity vectors (runs, r) and every instrument's fault plane, (runs, count).

    pi/2 for p = 0, which points at nobody. Source: section 4.1 of Kim et al.
    """
    out = _left_out(reference, used)
    away = np.linalg.norm(np.matvec(reference.plain_outside[out[:, None] | _bits(reference)], p[:, None]), axis=-1)
    length = np.linalg.norm(np.matvec(reference.plain_outside[out], p), axis=-1)[:, None]
    nowhere = length == 0.0
    return np.asarray(np.arcsin(np.minimum(np.where(nowhere, 1.0, away / np.where(nowhere, 1.0, length)), 1.0)))


def fault_sizes(reference: Reference, p: Array) -> Array:
    """Most likely fault of every axis, were it the only one at fault, (runs, axes), in the readings' unit.

    Divided by its own standard deviation, 1 / sensitivity, it is the residual along Jin and Zhang's optimal parity
    vector C^-1 v_j: of all combinations of parity equations the one that shows this axis best above what C allows. The
    square of that is DF_j.
    """
    along = np.matvec(reference.whitened_axes, np.matvec(reference.whitener, p))
    return np.asarray(along / np.square(reference.sensitivity[0]))


def parity_test(
    reference: Reference,
    readings: Array,
    p_fa: float,
    subjects: Sequence[str],
    used: Mask | None = None,
    name: str = "parity",
) -> tuple[TestResult, ...]:
    """Detect by FD, isolate by the fault plane that p lies in.

    `readings` (runs, axes); `subjects` names the set and then each instrument; `used` (runs, count), all by default.
    The set alarms when FD exceeds chi-square on r dof. Instrument k's statistic is the part of p outside its plane (for
    three 2-DOF instruments (n_k.p / sigma)^2), chi-square while k alone is at fault. k is a candidate when the set
    alarms and its statistic is *below* its threshold, and it alarms when of all candidates it has the smallest. `extra`
    of every instrument: `candidate` (runs,), and `ambiguous` (runs,), when there is more than one. An instrument whose
    absence would leave no redundancy has dof 0 and is never a candidate. Source: (29)-(32), with a statistic in place
    of the angle.
    """
    seen = _see(reference, readings, p_fa, subjects, used, name)
    without = seen.out[:, None] | _bits(reference)
    outside = np.matvec(reference.outside[without], seen.whitened[:, None])
    dof = reference.dof[without]
    return seen.instruments(np.asarray(np.vecdot(outside, outside)), dof, threshold(p_fa, dof), dof > 0)


def angle_test(
    reference: Reference,
    readings: Array,
    p_fa: float,
    subjects: Sequence[str],
    used: Mask | None = None,
    limit: float = ANGLE_THRESHOLD,
    name: str = "parity-angle",
) -> tuple[TestResult, ...]:
    """Detect by FD, isolate by the angle of p to the fault planes: Kim et al.'s own rule.

    They declare every instrument below `limit` [rad]: `extra["candidate"]`; of several the nearest alarms. Arguments
    and results otherwise as in `parity_test`; an instrument's statistic is FI_k [rad].
    """
    seen = _see(reference, readings, p_fa, subjects, used, name)
    dof = reference.dof[seen.out[:, None] | _bits(reference)]
    angles = fault_angles(reference, seen.p, used)
    return seen.instruments(angles, dof, np.full(angles.shape, limit), dof > 0)


def glt_test(
    reference: Reference,
    readings: Array,
    p_fa: float,
    subjects: Sequence[str],
    used: Mask | None = None,
    name: str = "glt",
) -> tuple[TestResult, ...]:
    """Detect by FD, isolate by the generalised likelihood test: DF_j = (p.v_j)^2 / (v_j.v_j), largest for the culprit.

    Arguments as in `parity_test`. An instrument's statistic is the largest DF_j of its axes (each chi-square on 1 dof
    without a fault); it alarms when the set does and no other has a larger one. `extra` of every instrument: `axis`
    (runs,), the one of the largest DF, counted over all axes from 0; `size` (runs,), the most likely fault of that
    axis, readings' unit; `explained` (runs,), the part of FD that a fault of all its axes would explain. With a single
    degree of freedom left every axis explains the same, and none is named. Sources: Zhang and Zhang (1990); Daly et al.
    """
    seen = _see(reference, readings, p_fa, subjects, used, name)
    owner, count = reference.cluster.instrument, reference.cluster.count
    sensitivity = reference.sensitivity[seen.out]
    felt = sensitivity > 0.0
    along = np.matvec(reference.whitened_axes, seen.whitened)
    along = np.where(felt, along / np.where(felt, sensitivity, 1.0), 0.0)
    of_instrument = np.where(owner == np.arange(count)[:, None], np.square(along)[:, None], -1.0)
    axis = of_instrument.argmax(axis=-1)
    DF = of_instrument.max(axis=-1)
    size = np.take_along_axis(along / np.where(felt, sensitivity, np.inf), axis, axis=1)
    outside = np.matvec(reference.outside[seen.out[:, None] | _bits(reference)], seen.whitened[:, None])
    explained = seen.set.statistic[:, None] - np.vecdot(outside, outside)
    largest = DF.argmax(axis=1)[:, None] == np.arange(count)
    alarm = seen.set.alarm[:, None] & largest & (seen.set.dof > 1)[:, None]
    dof = np.where(seen.used, 1, 0)
    return seen.results(
        DF, dof, threshold(p_fa, dof), alarm, {"axis": axis, "size": size, "explained": np.asarray(explained)}
    )


def optimal_parity_test(
    reference: Reference,
    readings: Array,
    p_fa: float,
    subjects: Sequence[str],
    used: Mask | None = None,
    name: str = "optimal-parity",
) -> tuple[TestResult, ...]:
    """Watch each instrument along the parity vector that shows its fault best: Jin and Zhang's, for all its axes.

    Arguments as in `parity_test`. Of all combinations of parity equations C^-1 V f shows a fault f best above what C
    allows. An instrument's statistic is the largest such residual squared over its possible f: the part of FD that a
    fault of it explains, chi-square on its axes without a fault. It alarms above its own threshold, whatever FD says,
    when no other explains more. `extra` of every instrument: `candidate` (runs,), above its threshold. With a single
    degree of freedom left every instrument explains the same, and none is named.
    """
    seen = _see(reference, readings, p_fa, subjects, used, name)
    without = seen.out[:, None] | _bits(reference)
    outside = np.matvec(reference.outside[without], seen.whitened[:, None])
    explained = np.maximum(seen.set.statistic[:, None] - np.vecdot(outside, outside), 0.0)
    dof = seen.set.dof[:, None] - reference.dof[without]
    limits = threshold(p_fa, dof)
    candidate = (explained >= limits) & (dof > 0) & seen.used & (seen.set.dof > 1)[:, None]
    largest = explained.argmax(axis=1)[:, None] == np.arange(explained.shape[1])
    return seen.results(explained, dof, limits, candidate & largest, {"candidate": candidate})


def ambiguity_map(
    reference: Reference, limit: float = ANGLE_THRESHOLD, directions: int = 360
) -> tuple[Array, Array, Mask]:
    """Which faults of two-axis instruments the angle test cannot place, noise aside.

    Returns the direction of the fault between the instrument's first and second axis, over half a turn (directions,)
    [rad]; FI of every instrument (count, directions, count) [rad]: of which instrument failed, then to whose plane; and
    whether more than one lies below `limit` (count, directions). Instruments with other numbers of axes show nan and
    False. Source: section 4.1 of Kim et al.
    """
    cluster = reference.cluster
    angle = np.asarray(np.linspace(0.0, np.pi, directions, endpoint=False), dtype=np.float64)
    FI = np.full((cluster.count, directions, cluster.count), np.nan)
    for k in range(cluster.count):
        mine = np.flatnonzero(cluster.instrument == k)
        if len(mine) == 2:
            fault = np.cos(angle)[:, None] * cluster.V[:, mine[0]] + np.sin(angle)[:, None] * cluster.V[:, mine[1]]
            FI[k] = fault_angles(reference, fault)
    return angle, FI, np.asarray((limit > FI).sum(axis=-1) > 1)


def ambiguous_bands(reference: Reference, limit: float = ANGLE_THRESHOLD) -> tuple[tuple[Band, ...], ...]:
    """`ambiguity_map` without a grid: the faults of each two-axis instrument that lie nearer than `limit` [rad] to
    another's plane.

    For every instrument bands (start, end, other instrument) in rising order; start and end [rad] between 0 and pi are
    directions from its first axis over its second. A band across 0 comes in two parts. In FI_j < limit, that is
    f' (M_j - sin^2(limit)) f < 0 with the projection M_j out of plane j, a fault f at direction a enters by cos 2a and
    sin 2a only. Source: section 4.1 of Kim et al.
    """
    cluster = reference.cluster
    found: list[tuple[Band, ...]] = []
    for k in range(cluster.count):
        mine = cluster.V[:, cluster.instrument == k]
        bands: list[Band] = []
        for other in range(cluster.count) if mine.shape[1] == 2 else ():
            if other == k:
                continue
            M = mine.T @ (reference.plain_outside[1 << other] - np.sin(limit) ** 2 * np.eye(len(mine))) @ mine
            mean, swing = 0.5 * (M[0, 0] + M[1, 1]), np.hypot(0.5 * (M[0, 0] - M[1, 1]), M[0, 1])
            centre = 0.5 * (np.arctan2(2.0 * M[0, 1], M[0, 0] - M[1, 1]) + np.pi)
            half = 0.5 * np.arccos(np.clip(mean / max(swing, _NOTHING * abs(mean), 1e-300), -1.0, 1.0))
            start, length = float((centre - half) % np.pi), float(2.0 * half)
            if length >= np.pi - _NOTHING:
                bands.append((0.0, float(np.pi), other))
            elif length > 0.0:
                beyond = start + length - float(np.pi)
                bands += [(start, min(start + length, float(np.pi)), other)]
                bands += [(0.0, beyond, other)] if beyond > 0.0 else []
        found.append(tuple(sorted(bands)))
    return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What all tests begin with."""

    name: str
    subjects: Sequence[str]
    p: Array
    whitened: Array
    out: Ints
    """Index of those left out, (runs or 1,)."""
    used: Mask
    """(runs, count)."""
    set: TestResult

    def instruments(self, statistic: Array, dof: Ints, limits: Array, can: Mask) -> tuple[TestResult, ...]:
        """Results for instruments whose statistic is small when they are at fault."""
        can = can & self.used & self.set.alarm[:, None]
        candidate = can & (statistic < limits)
        ambiguous = candidate.sum(axis=1, keepdims=True) > 1
        nearest = np.where(candidate, statistic, np.inf).argmin(axis=1)[:, None] == np.arange(self.used.shape[1])
        extra = {"candidate": candidate, "ambiguous": np.broadcast_to(ambiguous, candidate.shape)}
        return self.results(statistic, dof, limits, candidate & nearest, extra)

    def results(
        self, statistic: Array, dof: Ints, limits: Array, alarm: Mask, extra: Mapping[str, NDArray[Any]]
    ) -> tuple[TestResult, ...]:
        """The set's result and one for every instrument, from arrays (runs, count)."""
        statistic = np.where(self.used, statistic, 0.0)
        dof, limits = np.where(self.used, dof, 0), np.broadcast_to(limits, statistic.shape)
        one_each = (
            TestResult(
                self.name,
                subject,
                statistic[:, k],
                dof[:, k],
                limits[:, k],
                alarm[:, k],
                self.p,
                self.set.covariance,
                {key: value[:, k] for key, value in extra.items()},
            )
            for k, subject in enumerate(self.subjects[1:])
        )
        return self.set, *one_each


def _see(
    reference: Reference, readings: Array, p_fa: float, subjects: Sequence[str], used: Mask | None, name: str
) -> _Seen:
    """The parity vector, whitened and projected, and the test of the whole set."""
    runs, count = len(readings), reference.cluster.count
    if len(subjects) != count + 1:
        raise ValueError(f"name the set and its {count} instruments; got {len(subjects)} names: {list(subjects)}")
    out = _left_out(reference, used)
    if used is None:
        used = np.ones((runs, count), dtype=bool)
    else:
        used = np.broadcast_to(used, (runs, count))
        readings = np.where(used[:, reference.cluster.instrument], readings, 0.0)  # they may hold anything, NaN too
    p = parity_vector(reference, readings)
    whitened = np.matvec(reference.outside[out], np.matvec(reference.whitener, p))
    p = np.matvec(reference.plain_outside[out], p)
    FD = np.asarray(np.vecdot(whitened, whitened))
    dof, limit, alarm = decide(FD, reference.dof[out], p_fa)
    C = np.broadcast_to(reference.covariance, (runs, *reference.covariance.shape))
    return _Seen(name, subjects, p, whitened, out, used, TestResult(name, subjects[0], FD, dof, limit, alarm, p, C))


def _left_out(reference: Reference, used: Mask | None) -> Ints:
    return np.zeros(1, dtype=np.int64) if used is None else mask_index(~used)


def _bits(reference: Reference) -> Ints:
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
    """Projections out of the span of the rows of `axes` (axes, r) of every set of instruments, and what is left."""
    sets = np.arange(2**cluster.count)[:, None] >> np.arange(cluster.count) & 1
    rows = axes * sets[:, cluster.instrument, None]
    _, size, basis = np.linalg.svd(rows, full_matrices=False)
    spanned = size > _NOTHING * np.abs(axes).max()
    basis = basis * spanned[..., None]
    return np.eye(axes.shape[1]) - basis.swapaxes(-1, -2) @ basis, np.asarray(axes.shape[1] - spanned.sum(axis=-1))


def _variance(cluster: Cluster, sigma: ArrayLike, what: str) -> Array:
    s = np.broadcast_to(np.asarray(sigma, dtype=float), (cluster.axes,))
    if not (np.isfinite(s) & (s >= 0.0)).all():
        raise ValueError(f"{what} must be a standard deviation of zero or more for each axis; got {s.tolist()}")
    return np.asarray(np.square(s))
