"""Parity space on the gyros of one aircraft: four tests beside each other, one of which declares.

001, section 4.1: FD on the squared parity vector, FI by its angle to the fault planes; beside them the distance from
the planes as a statistic, the GLT and the optimal parity vector.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import chi_square, parity
from ftcore.detection.geometry import Cluster
from ftcore.detection.parity import Reference
from ftcore.detection.result import TestResult
from ftcore.systems.base import Flags
from ftcore.systems.redundant_imu.forms import Settings
from ftcore.systems.redundant_imu.names import GYRO, SUBJECTS

Array = NDArray[np.float64]
NAMES = (GYRO, *SUBJECTS)


@dataclass(frozen=True)
class Verdict:
    """What parity space says at one epoch.

    Attributes:
        p: ``(runs, 3)`` parity vector of all gyros that read [rad/s].
        detected: ``(runs,)`` the gyros that are still trusted disagree.
        declared: ``(runs, 3)`` who of them is held for faulty; several where it cannot be told.
        statistic, threshold, dof, alarm: ``(runs, 14)`` columns of the tests: FD of all, of those that are trusted,
            then test by test the gyros.
    """

    p: Array
    detected: Flags
    declared: Flags
    statistic: Array
    threshold: Array
    dof: Array
    alarm: Flags


def reference(cluster: Cluster, noise: float) -> Reference:
    """A healthy cluster whose axes have white noise [rad/s] and no biases, as 001 has it."""
    return parity.uncalibrated(cluster, noise, 0.0)


def judge(expected: Reference, m: Array, reading: Flags, trusted: Flags, settings: Settings) -> Verdict:
    """Test readings ``m (runs, 6)`` of the gyros that read, and among them those still trusted, ``(runs, 3)`` each.

    The tests that are shown judge all that read, so that a fault stays in sight after it was isolated. GLT and optimal
    parity vector name nobody where two explain the parity vector equally well: they declare both. With a gyro out a
    single degree of freedom is left: another fault is detected, but every gyro that is left explains it equally, so
    all of them are declared. So they are when the parity vector lies in nobody's plane.
    """
    p_fa = settings.false_alarm_probability
    angle = parity.angle_test(expected, m, p_fa, NAMES, reading, math.radians(settings.angle_threshold))
    plane = parity.parity_test(expected, m, p_fa, NAMES, reading)
    glt = parity.glt_test(expected, m, p_fa, NAMES, reading)
    optimal = parity.optimal_parity_test(expected, m, p_fa, NAMES, reading)
    whole = rest = angle[0]
    near, close = _stack(angle[1:], "candidate"), _stack(plane[1:], "candidate")
    # Whoever explains the parity vector as well as the best does, within what noise does, is as guilty.
    explained = _stack(glt[1:], "explained")
    level = explained >= explained.max(axis=-1, keepdims=True) - chi_square.threshold(p_fa, 1)
    alone = level.sum(axis=-1, keepdims=True) == 1
    largest, shown = (np.array([r.alarm for r in test[1:]]).T for test in (glt, optimal))
    driver = {
        "isolation-angle": near,
        "fault-plane": close,
        "glt": np.where(alone, largest, level),
        "optimal-parity": np.where(alone, shown, level),
    }
    declared: Flags = np.zeros(near.shape, bool)
    fewer = (trusted != reading).any(axis=-1)
    if fewer.any():
        rest = parity.parity_test(expected, m, p_fa, NAMES, trusted)[0]
    if settings.driving_test != "none":
        declared = driver[settings.driving_test] & ~fewer[:, None]
        declared = (declared | ~declared.any(axis=-1, keepdims=True)) & trusted & rest.alarm[:, None]
    per_instrument = [*angle[1:], *plane[1:], *glt[1:], *optimal[1:]]

    def columns(field: str) -> Array:
        return np.array([getattr(r, field) for r in (whole, rest, *per_instrument)], dtype=np.float64).T

    return Verdict(
        p=np.asarray(whole.innovation),
        detected=rest.alarm,
        declared=declared,
        statistic=columns("statistic"),
        threshold=columns("threshold"),
        dof=columns("dof"),
        alarm=np.concatenate(
            [whole.alarm[:, None], rest.alarm[:, None], near, close, largest & alone, shown & alone], axis=-1
        ),
    )


def _stack(results: tuple[TestResult, ...], key: str) -> NDArray[Any]:
    return np.array([r.extra[key] for r in results]).T
