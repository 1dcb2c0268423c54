"""The redundant IMU as the navigator uses it: checked, reconfigured, solved for body rates and specific force.

Gyros and accelerometers are two clusters of the same geometry; arrays lead with ``(runs, 2)``. Detection works on the
mean over an epoch. The parity vector is calibrated before the flight (000 leaves the axis biases out; without a
calibration a healthy unit would alarm forever).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import chi_square, supervisor
from ftcore.detection.geometry import InstrumentSet
from ftcore.readings import Group
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.forms import Settings

Array = NDArray[np.float64]
CLUSTERS, INSTRUMENTS = 2, 3


@dataclass(frozen=True)
class ImuState:
    """Supervisor of the six instruments, and which of them were used in the epoch before ``(runs, 2, 3)``."""

    supervisor: supervisor.State
    used: Flags


@dataclass(frozen=True)
class ImuEpoch:
    """What the IMU gives the navigator.

    Attributes:
        omega_b, f_b: ``(runs, 2, samples, 3)``: protected (trusted instruments) and unprotected (all there are).
        parity: ``(runs, 2, 3)`` calibrated parity vectors.
        statistic, threshold, dof, alarm: ``(runs, 16)`` in the order of the description's IMU tests.
        decision: of the supervisor on ``(runs, 6)`` instruments.
        used: ``(runs, 2, 3)`` instruments in the protected solution.
        changed: ``(runs,)`` the protected solution's instruments changed.
        bias_change: ``(runs, 2, 3, 3)`` covariance of the jump of the body biases that a change brings.
        noise: ``(runs, 2, 2, 3, 3)`` body noise covariance density of protected and unprotected, for each cluster.
    """

    omega_b: Array
    f_b: Array
    parity: Array
    statistic: Array
    threshold: Array
    dof: Array
    alarm: Flags
    decision: supervisor.Decision
    used: Flags
    changed: Flags
    bias_change: Array
    noise: Array


class RedundantImu:
    """Checks and solves the redundant IMU.

    Args:
        instruments: geometry, the same for gyros and accelerometers.
        density: white noise densities of gyro and accelerometer axes [SI per sqrt(Hz)].
        bias: 1-sigma axis biases [SI].
        calibration: mean readings at rest ``(runs, 2, 6)``.
        calibration_time: how long they were taken [s].
        epoch: seconds between epochs.
    """

    def __init__(
        self,
        instruments: InstrumentSet,
        density: Array,
        bias: Array,
        calibration: Array,
        calibration_time: float,
        epoch: float,
    ) -> None:
        self._set = instruments
        self._density, self._bias = density, bias
        self._offset = calibration @ instruments.parity.T
        self._variance = density**2 * (1.0 / epoch + 1.0 / calibration_time)
        self._norms = np.vecdot(instruments.parity.T, instruments.parity.T)
        self._gains = instruments.gains
        # Body covariance of unit-variance axis errors for every set of instruments.
        self._spread = self._gains @ self._gains.swapaxes(-1, -2)

    def initial(self, runs: int) -> ImuState:
        """All instruments trusted."""
        return ImuState(supervisor.start(runs, CLUSTERS * INSTRUMENTS), np.ones((runs, CLUSTERS, INSTRUMENTS), bool))

    def step(
        self, state: ImuState, gyro: Group, accelerometer: Group, settings: Settings, rules: supervisor.Rules
    ) -> tuple[ImuState, ImuEpoch]:
        """One epoch of samples ``(runs, 6, samples)`` each."""
        samples = np.stack([gyro.values, accelerometer.values], axis=1)
        runs = len(samples)
        valid = np.stack(np.broadcast_arrays(gyro.valid, accelerometer.valid), axis=1)
        valid = np.broadcast_to(valid, (runs, CLUSTERS, valid.shape[-1]))
        present = valid.reshape(runs, CLUSTERS, INSTRUMENTS, -1).all(axis=-1)
        mean = samples.mean(axis=-1)
        if not valid.all():
            # An axis without a reading says what the others say: it can neither alarm nor hide an alarm.
            everything = self._mask(present)
            solution = np.matvec(self._gains[everything], np.where(valid, mean, 0.0))
            mean = np.where(valid, mean, solution @ self._set.axes.T)
            samples = np.where(valid[..., None], samples, 0.0)
        parity = mean @ self._set.parity.T - self._offset
        sigma2 = self._variance[:, None]
        fd = np.vecdot(parity, parity) / self._variance
        normal = (parity @ self._set.normals.T) ** 2 / sigma2
        per_axis = (parity @ self._set.parity) ** 2 / (self._norms * sigma2)
        glt = per_axis.reshape(runs, CLUSTERS, INSTRUMENTS, -1).max(axis=-1)
        p_fa = settings.false_alarm_probability
        t3, t1 = chi_square.threshold(p_fa, 3), chi_square.threshold(p_fa, 1)
        detected = fd > t3
        best = glt == glt.max(axis=-1, keepdims=True)
        in_plane = normal < t1
        named_by_parity = normal == normal.min(axis=-1, keepdims=True)
        fd_ = fd[..., None]
        alarm_parity = np.concatenate([detected[..., None], detected[..., None] & in_plane], axis=-1)
        alarm_glt = np.concatenate([detected[..., None], detected[..., None] & best], axis=-1)
        statistic = np.stack([np.concatenate([fd_, normal], -1), np.concatenate([fd_, glt], -1)], axis=1)
        alarm = np.stack([alarm_parity, alarm_glt], axis=1)
        thresholds = np.broadcast_to(np.array([t3, t1, t1, t1], float), statistic.shape)
        dof = np.broadcast_to(np.array([3.0, 1.0, 1.0, 1.0]), statistic.shape)

        driver = settings.imu_driving_test
        accused = best if driver == "glt" else named_by_parity
        driving = (detected[..., None] & accused) if driver != "none" else np.zeros_like(accused)
        # Two instruments are the least that can be solved: while one is out, nobody else can be put out.
        out = (state.supervisor.health == supervisor.ISOLATED).reshape(runs, CLUSTERS, INSTRUMENTS)
        driving = driving & (out | ~out.any(axis=-1, keepdims=True))
        admitted = np.repeat(~detected, INSTRUMENTS, axis=-1)
        supervision, decision = supervisor.step(
            state.supervisor, driving.reshape(runs, -1), admitted, np.ones((1, 6), bool), rules
        )
        used = decision.use.reshape(runs, CLUSTERS, INSTRUMENTS)
        # With fewer than two left (a second one without readings), all that are there are used in spite of everything.
        used = np.where((used & present).sum(axis=-1, keepdims=True) >= 2, used & present, present)
        now, before = self._mask(used), self._mask(state.used)
        gains = self._gains[np.stack([now, self._mask(present)], axis=-1)]
        body = np.swapaxes(gains @ samples[:, :, None], -1, -2)
        change = self._gains[now] - self._gains[before]
        bias_change = change @ change.swapaxes(-1, -2) * (self._bias**2)[:, None, None]
        noise = self._spread[np.stack([now, self._mask(present)], axis=1)] * (self._density**2)[:, None, None]
        epoch = ImuEpoch(
            omega_b=body[:, 0],
            f_b=body[:, 1],
            parity=parity,
            statistic=statistic.reshape(runs, -1),
            threshold=thresholds.reshape(runs, -1),
            dof=dof.reshape(runs, -1),
            alarm=alarm.reshape(runs, -1),
            decision=decision,
            used=used,
            changed=(now != before).any(axis=-1),
            bias_change=bias_change,
            noise=noise,
        )
        return ImuState(supervision, used), epoch

    @staticmethod
    def _mask(used: Flags) -> NDArray[np.intp]:
        """Index into the gains: bit k set where instrument k + 1 is used, ``(runs, 2)``."""
        return used @ np.array([1, 2, 4])
