"""Parity space on the gyros of one aircraft: four tests beside each other, one of which declares.

Kim 2005, section 4.1: FD on the squared parity vector, FI by its angle to the fault planes; beside them the distance
from the planes as a statistic, the GLT and the optimal parity vector.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import chi_square, parity
from ftcore.detection.geometry import Cluster
from ftcore.detection.parity import Reference, Sight
from ftcore.systems.base import Flags
from ftcore.systems.redundant_imu.forms import Settings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Verdict:
    """What parity space says at one epoch.

    Attributes:
        p: ``(runs, 3)`` parity vector of all gyros that read [rad/s].
        detected: ``(runs,)`` the gyros that are still trusted disagree.
        declared: ``(runs, 3)`` who of them is held for faulty; several where it cannot be told.
        spare: ``(runs, 3)`` where several are declared, the one of those that read, isolated or not, without which the
            other two agree best; nobody where two choices are alike but for the noise, or where fewer than three read.
        whole: what was seen of all that read.
        statistic, threshold, dof, alarm: ``(runs, 14)`` columns of the tests: FD of all, of those that are trusted,
            then test by test the gyros.
    """

    p: Array
    detected: Flags
    declared: Flags
    spare: Flags
    whole: Sight
    statistic: Array
    threshold: Array
    dof: Array
    alarm: Flags


def reference(cluster: Cluster, noise: float) -> Reference:
    """A healthy cluster whose axes have white noise [rad/s] and no biases, as Kim 2005 has it."""
    return parity.uncalibrated(cluster, noise, 0.0)


def judge(expected: Reference, m: Array, reading: Flags, trusted: Flags, settings: Settings) -> Verdict:
    """Test readings ``m (runs, 6)`` of the gyros that read, and among them those still trusted, ``(runs, 3)`` each.

    The tests that are shown judge all that read, so that a fault stays in sight after it was isolated. GLT and optimal
    parity vector name nobody where two explain the parity vector equally well: they declare both. With a gyro out a
    single degree of freedom is left: another fault is detected, but every gyro that is left explains it equally, so
    all of them are declared. So they are when the parity vector lies in nobody's plane.
    """
    p_fa = settings.false_alarm_probability
    whole = rest = parity.look(expected, m, p_fa, reading)
    angle = parity.by_angle(whole, math.radians(settings.angle_threshold))
    plane = parity.by_plane(whole)
    glt = parity.by_likelihood(whole)
    optimal = parity.by_optimal_vector(whole)
    near, close = angle.extra["candidate"], plane.extra["candidate"]
    # Whoever explains the parity vector as well as the best does, within what noise does, is as guilty.
    explained = glt.extra["explained"]
    level = explained >= explained.max(axis=-1, keepdims=True) - chi_square.threshold(p_fa, 1)
    alone = level.sum(axis=-1, keepdims=True) == 1
    driver = {
        "isolation-angle": near,
        "fault-plane": close,
        "glt": np.where(alone, glt.alarm, level),
        "optimal-parity": np.where(alone, optimal.alarm, level),
    }
    declared: Flags = np.zeros(near.shape, bool)
    fewer = (trusted != reading).any(axis=-1)
    if fewer.any():
        rest = parity.look(expected, m, p_fa, trusted)
    if settings.driving_test != "none":
        declared = driver[settings.driving_test] & ~fewer[:, None]
        declared = (declared | ~declared.any(axis=-1, keepdims=True)) & trusted & rest.alarm[:, None]
    several = declared.sum(axis=-1, keepdims=True) > 1
    least = whole.outside <= whole.outside.min(axis=-1, keepdims=True) + chi_square.threshold(p_fa, 1)
    spare = least & (least.sum(axis=-1, keepdims=True) == 1) & several & reading.all(axis=-1, keepdims=True)
    sets, instruments = (whole, rest), (angle, plane, glt, optimal)

    def columns(of_sets: str, of_instruments: str) -> Array:
        first = np.stack([getattr(s, of_sets) for s in sets], axis=-1)
        return np.concatenate([first, *(getattr(i, of_instruments) for i in instruments)], axis=-1, dtype=np.float64)

    return Verdict(
        p=whole.p,
        detected=rest.alarm,
        declared=declared,
        spare=spare,
        whole=whole,
        statistic=columns("FD", "statistic"),
        threshold=columns("threshold", "threshold"),
        dof=columns("dof", "dof"),
        alarm=np.concatenate(
            [whole.alarm[:, None], rest.alarm[:, None], near, close, glt.alarm & alone, optimal.alarm & alone], axis=-1
        ),
    )
