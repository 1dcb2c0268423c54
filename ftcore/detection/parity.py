"""Tests of redundant instruments against each other, in parity space.

Statistics are formed with the covariance C of p, that is with p and V whitened by C^-1/2; for C = sigma^2 I they are
the papers' own divided by sigma^2, and thresholds are quantiles of chi-square.

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
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore.detection.chi_square import decide, threshold
from ftcore.detection.geometry import mask_index
from ftcore.detection.parity_space import (
    Reference,
    angles_outside,
    bits,
    calibrate,
    fault_angles,
    fault_sizes,
    momentary,
    parity_vector,
    uncalibrated,
)
from ftcore.detection.result import Array, Ints, Mask, TestResult

__all__ = [
    "ANGLE_THRESHOLD",
    "Isolation",
    "Reference",
    "Sight",
    "admission",
    "angle_test",
    "by_angle",
    "by_likelihood",
    "by_optimal_vector",
    "by_plane",
    "calibrate",
    "fault_angles",
    "fault_sizes",
    "glt_test",
    "look",
    "momentary",
    "optimal_parity_test",
    "parity_test",
    "parity_vector",
    "uncalibrated",
]

ANGLE_THRESHOLD = float(np.deg2rad(15.0))
"""Default T_i. At 10 degrees noise leaves one in seven of the paper's faults with a single or a wrong declaration."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What all tests begin with; made by `look`."""

    reference: Reference
    p_fa: float
    out: Ints
    """Index of those left out, (runs or 1,)."""
    used: Mask
    """(runs, count)."""
    p: Array
    """Parity vectors, (runs, r)."""
    whitened: Array
    """(runs, r)."""
    FD: Array
    """Of the whole set, (runs,), as are its degrees of freedom, threshold and alarm."""
    dof: Ints
    threshold: Array
    alarm: Mask

    @cached_property
    def without(self) -> Ints:
        """Index of those left out and each instrument besides, (runs or 1, count)."""
        return np.asarray(self.out[:, None] | bits(self.reference))

    @cached_property
    def outside(self) -> Array:
        """The part of FD that a fault of each instrument does not explain, (runs, count)."""
        rest = np.matvec(self.reference.outside_of(self.without), self.whitened[:, None])
        return np.asarray(np.vecdot(rest, rest))

    @cached_property
    def outside_dof(self) -> Ints:
        """Its degrees of freedom, (runs or 1, count); 0 where nothing is left."""
        return np.asarray(self.reference.dof[self.without])


@dataclass(frozen=True, slots=True, eq=False)
class Isolation:
    """What a test says of every instrument; all (runs, count)."""

    statistic: Array
    dof: Ints
    threshold: Array
    alarm: Mask
    extra: Mapping[str, NDArray[Any]]


def look(reference: Reference, readings: Array, p_fa: float, used: Mask | None = None) -> Sight:
    """Parity vectors of readings (runs, axes), and the test of the whole set: FD against chi-square.

    `used` (runs, count), all by default; readings of the others may be anything, NaN too. Source: (29)-(32).
    """
    runs, count = len(readings), reference.cluster.count
    if used is None:
        out = np.zeros(1, dtype=np.int64)
        used = np.ones((runs, count), dtype=bool)
    else:
        out = mask_index(~used)
        used = np.broadcast_to(used, (runs, count))
        readings = np.where(used[:, reference.cluster.instrument], readings, 0.0)
    p = parity_vector(reference, readings)
    whitened = np.matvec(reference.outside_of(out), np.matvec(reference.whitener, p))
    p = np.matvec(reference.plain_outside[out], p)
    FD = np.asarray(np.vecdot(whitened, whitened))
    dof, limit, alarm = decide(FD, reference.dof[out], p_fa)
    return Sight(reference, p_fa, out, used, p, whitened, FD, dof, limit, alarm)


def admission(sight: Sight, trusted: Mask, disagree: Mask, p_fa: float) -> Mask:
    """Who of those that are used in `sight`, but not `trusted`, may be trusted again, (runs, count).

    trusted (runs, count); disagree (runs,): the trusted contradict each other. An instrument comes back when all of
    `sight` agree, whoever was isolated; and, where the trusted disagree, when all would agree without one of these: a
    single fault, which has left the one and reached the other, then explains everything. `p_fa`: of each comparison.
    """
    quiet = (sight.dof > 0) & ~decide(sight.FD, sight.dof, p_fa)[2]
    without = (sight.outside_dof > 0) & ~decide(sight.outside, sight.outside_dof, p_fa)[2]
    moved = disagree & (without & trusted).any(axis=-1)
    return np.asarray((quiet | moved)[:, None] & sight.used & ~trusted)


def by_plane(sight: Sight) -> Isolation:
    """Isolate by the fault plane that p lies in; see `parity_test`."""
    return _nearest(sight, sight.outside, threshold(sight.p_fa, sight.outside_dof))


def by_angle(sight: Sight, limit: float = ANGLE_THRESHOLD) -> Isolation:
    """Isolate by the angle between p and the fault planes; see `angle_test`."""
    angles = angles_outside(sight.reference, sight.p, sight.without)
    return _nearest(sight, angles, np.full((1, angles.shape[1]), limit))


def by_likelihood(sight: Sight) -> Isolation:
    """Isolate by the generalised likelihood test; see `glt_test`."""
    reference = sight.reference
    owner, count = reference.cluster.instrument, reference.cluster.count
    sensitivity = reference.sensitivity_without(sight.out)
    felt = sensitivity > 0.0
    along = np.matvec(reference.whitened_axes, sight.whitened)
    along = np.divide(along, sensitivity, out=np.zeros_like(along), where=felt)
    of_instrument = np.where(owner == np.arange(count)[:, None], np.square(along)[:, None], -1.0)
    axis = of_instrument.argmax(axis=-1)
    DF = of_instrument.max(axis=-1)
    size = np.take_along_axis(along / np.where(felt, sensitivity, np.inf), axis, axis=1)
    largest = DF.argmax(axis=1)[:, None] == np.arange(count)
    alarm = largest & (sight.alarm & (sight.dof > 1))[:, None]
    explained = sight.FD[:, None] - sight.outside
    dof = sight.used.astype(np.int64)
    return _isolation(
        sight, DF, dof, threshold(sight.p_fa, dof), alarm, {"axis": axis, "size": size, "explained": explained}
    )


def by_optimal_vector(sight: Sight) -> Isolation:
    """Isolate by the optimal parity vector; see `optimal_parity_test`."""
    explained = np.maximum(sight.FD[:, None] - sight.outside, 0.0)
    dof = sight.dof[:, None] - sight.outside_dof
    limits = threshold(sight.p_fa, dof)
    candidate = (explained >= limits) & (dof > 0) & sight.used & (sight.dof > 1)[:, None]
    largest = explained.argmax(axis=1)[:, None] == np.arange(explained.shape[1])
    return _isolation(sight, explained, dof, limits, candidate & largest, {"candidate": candidate})


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
    sight = look(reference, readings, p_fa, used)
    return _results(name, subjects, sight, by_plane(sight))


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
    sight = look(reference, readings, p_fa, used)
    return _results(name, subjects, sight, by_angle(sight, limit))


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
    sight = look(reference, readings, p_fa, used)
    return _results(name, subjects, sight, by_likelihood(sight))


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
    sight = look(reference, readings, p_fa, used)
    return _results(name, subjects, sight, by_optimal_vector(sight))


def _nearest(sight: Sight, statistic: Array, limits: Array) -> Isolation:
    """For a statistic (runs, count) that is small when an instrument is at fault: the nearest below its limit."""
    dof = sight.outside_dof
    candidate = (statistic < limits) & (dof > 0) & sight.used & sight.alarm[:, None]
    ambiguous = candidate.sum(axis=1, keepdims=True) > 1
    nearest = np.where(candidate, statistic, np.inf).argmin(axis=1)[:, None] == np.arange(statistic.shape[1])
    extra = {"candidate": candidate, "ambiguous": np.broadcast_to(ambiguous, candidate.shape)}
    return _isolation(sight, statistic, dof, limits, candidate & nearest, extra)


def _isolation(
    sight: Sight, statistic: Array, dof: Ints, limits: Array, alarm: Mask, extra: Mapping[str, NDArray[Any]]
) -> Isolation:
    """Those not used have nothing to be judged by."""
    return Isolation(
        np.where(sight.used, statistic, 0.0),
        np.where(sight.used, dof, 0),
        limits + np.zeros(statistic.shape),
        alarm,
        extra,
    )


def _results(name: str, subjects: Sequence[str], sight: Sight, found: Isolation) -> tuple[TestResult, ...]:
    """The set's result and one for every instrument. Raises ValueError unless all are named."""
    runs, count = sight.used.shape
    if len(subjects) != count + 1:
        raise ValueError(f"name the set and its {count} instruments; got {len(subjects)} names: {list(subjects)}")
    C = np.broadcast_to(sight.reference.covariance, (runs, *sight.reference.covariance.shape))
    whole = TestResult(name, subjects[0], sight.FD, sight.dof, sight.threshold, sight.alarm, sight.p, C)
    one_each = (
        TestResult(
            name,
            subject,
            found.statistic[:, k],
            found.dof[:, k],
            found.threshold[:, k],
            found.alarm[:, k],
            sight.p,
            C,
            {key: value[:, k] for key, value in found.extra.items()},
        )
        for k, subject in enumerate(subjects[1:])
    )
    return whole, *one_each
