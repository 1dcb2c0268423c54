"""The IMU as the navigator uses it: samples along the body axes, of the plain IMU or of the redundant one with its FDI.

Two solutions where there are two: *protected*, of the instruments that are trusted, and *unprotected*, of all there
are. The plain IMU has one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore import units
from ftcore.detection import supervisor
from ftcore.detection.geometry import Cluster, three_two_dof
from ftcore.readings import Group, Readings
from ftcore.systems.base import LeftOut
from ftcore.systems.sins_gps_bd2_cns.forms import EPOCH, Parameters, Settings
from ftcore.systems.sins_gps_bd2_cns.inertial import BODY
from ftcore.systems.sins_gps_doppler.forms import Settings as RedundantSettings
from ftcore.systems.sins_gps_doppler.imu import ImuEpoch, ImuState, RedundantImu
from ftcore.systems.two_axis import unpaired

Array = NDArray[np.float64]
GROUPS = ("imu.gyro", "imu.accelerometer")


@dataclass(frozen=True)
class State:
    """Mean readings of the plain IMU's last epoch ``(runs, 2, 3)``, and what the redundant IMU carries."""

    held: Array
    redundant: ImuState | None


@dataclass(frozen=True)
class Epoch:
    """What the IMU gives the navigator; S is 1 for the plain IMU, 2 for the redundant one.

    Attributes:
        omega_b, f_b: ``(runs, S, samples, 3)``.
        noise: ``(runs or 1, S, 2, 3, 3)`` body noise covariance density of gyros and accelerometers.
        redundant: its own report; None without one.
        left_out: readings that are there but that it does not use, by group.
    """

    omega_b: Array
    f_b: Array
    noise: Array
    redundant: ImuEpoch | None
    left_out: Mapping[str, LeftOut]


def geometry(p: Parameters) -> Cluster:
    """Three 2-DOF instruments at the mounting angles: the redundant IMU."""
    return three_two_dof(*(math.radians(angle) for angle in p.inertial.mounting))


def input_axes(p: Parameters) -> Array:
    """Unit input axes ``(k, 3)`` of the IMU that is fitted."""
    return np.eye(3) if p.inertial.configuration == "three-axis" else geometry(p).H


class Imu:
    """Either IMU. ``calibration`` are the mean readings at rest ``(runs, 2, k)``.

    ``noise (1, 1, 2, 3, 3)``: body noise covariance density of the plain one.
    """

    def __init__(self, p: Parameters, runs: int, calibration: Array) -> None:
        i = p.inertial
        self.runs = runs
        self.density = np.array(
            [units.to_si(i.angle_random_walk, "deg/sqrt(h)"), units.to_si(i.accelerometer_noise, "ug/sqrt(Hz)")]
        )
        self.bias = np.array([units.to_si(i.gyro_bias, "deg/h"), units.to_si(i.accelerometer_bias, "ug")])
        self.cluster = None if i.configuration == "three-axis" else geometry(p)
        self._redundant: RedundantImu | None = None
        if self.cluster is not None:
            scale = units.to_si(i.scale_factor, "ppm")
            self._redundant = RedundantImu(
                self.cluster, self.density, self.bias, calibration, i.calibration, EPOCH, scale
            )
        self.noise = (np.square(self.density)[:, None, None] * np.eye(3))[None, None]

    @property
    def solutions(self) -> int:
        """How many solutions there are: 1, or protected and unprotected."""
        return 1 if self._redundant is None else 2

    def bias_covariance(self) -> Array:
        """Covariance of the body biases of gyros and accelerometers, ``(2, 3, 3)``."""
        body = np.eye(3) if self.cluster is None else self.cluster.covariances[-1]
        return np.asarray(np.square(self.bias)[:, None, None] * body)

    def initial(self) -> State:
        """Nothing read yet."""
        redundant = None if self._redundant is None else self._redundant.initial(self.runs)
        return State(np.zeros((self.runs, len(GROUPS), 3)), redundant)

    def step(
        self, state: State, readings: Readings, settings: Settings, rules: supervisor.Rules
    ) -> tuple[State, Epoch]:
        """One epoch of samples."""
        gyro, accelerometer = (readings[name] for name in GROUPS)
        if self._redundant is None:
            held, (omega_b, f_b) = self._plain(state.held, (gyro, accelerometer))
            return State(held, None), Epoch(omega_b[:, None], f_b[:, None], self.noise, None, {})
        assert state.redundant is not None
        after, found = self._redundant.step(
            state.redundant,
            _pairs(gyro),
            _pairs(accelerometer),
            RedundantSettings(
                false_alarm_probability=settings.false_alarm_probability, imu_driving_test=settings.imu_driving_test
            ),
            rules,
        )
        left_out = unpaired(readings, GROUPS, len(BODY))
        return State(state.held, after), Epoch(found.omega_b, found.f_b, found.noise, found, left_out)

    def _plain(self, held: Array, groups: tuple[Group, Group]) -> tuple[Array, list[Array]]:
        """Samples ``(runs, samples, 3)`` of gyros and accelerometers; an axis without readings holds the last."""
        found, means = [], []
        for i, group in enumerate(groups):
            samples = group.values[:, : len(BODY)]
            if not group.valid[:, : len(BODY)].all():
                samples = np.where(group.valid[:, : len(BODY), None], samples, held[:, i, :, None])
            means.append(samples.sum(axis=-1) / samples.shape[-1])
            found.append(samples.swapaxes(-1, -2))
        return np.stack(means, axis=1), found


def _pairs(group: Group) -> Group:
    """The redundant IMU's columns of a group."""
    return Group(group.values[:, len(BODY) :], group.valid[:, len(BODY) :], group.times)
