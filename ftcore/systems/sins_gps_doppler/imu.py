"""The redundant IMU as the navigator uses it: checked, reconfigured, solved for body rates and specific force.

Gyros and accelerometers are two clusters of the same geometry; arrays lead with ``(runs, 2)``. Detection works on the
mean over an epoch. The parity vector is calibrated before the flight (000 leaves the axis biases out; without a
calibration a healthy unit would alarm forever).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import parity, supervisor
from ftcore.detection.geometry import Cluster, mask_index
from ftcore.readings import Group
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.forms import Settings

Array = NDArray[np.float64]
CLUSTERS, INSTRUMENTS = 2, 3
SUBJECTS = ("set", "1", "2", "3")


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
        cluster: geometry, the same for gyros and accelerometers.
        density: white noise densities of gyro and accelerometer axes [SI per sqrt(Hz)].
        bias: 1-sigma axis biases [SI].
        calibration: mean readings at rest ``(runs, 2, 6)``.
        calibration_time: how long they were taken [s].
        epoch: seconds between epochs.
    """

    def __init__(
        self, cluster: Cluster, density: Array, bias: Array, calibration: Array, calibration_time: float, epoch: float
    ) -> None:
        self._cluster = cluster
        self._density, self._bias = density, bias
        # In units of its own noise a gyro is an accelerometer: one reference serves both, stacked along the runs.
        self._unit = np.maximum(density, 1e-12) / math.sqrt(epoch)
        at_rest = (calibration / self._unit[:, None]).reshape(-1, 1, cluster.axes)
        self._reference = parity.calibrate(cluster, at_rest, 1.0, math.sqrt(epoch / calibration_time))

    def initial(self, runs: int) -> ImuState:
        """All instruments trusted."""
        return ImuState(supervisor.start(runs, CLUSTERS * INSTRUMENTS), np.ones((runs, CLUSTERS, INSTRUMENTS), bool))

    def step(
        self, state: ImuState, gyro: Group, accelerometer: Group, settings: Settings, rules: supervisor.Rules
    ) -> tuple[ImuState, ImuEpoch]:
        """One epoch of samples ``(runs, 6, samples)`` each."""
        samples = np.stack([gyro.values, accelerometer.values], axis=1)
        runs = len(samples)
        mean = samples.mean(axis=-1)
        present: Flags = np.ones((runs, CLUSTERS, INSTRUMENTS), bool)
        if not (gyro.valid.all() and accelerometer.valid.all()):
            valid = np.broadcast_to(np.stack(np.broadcast_arrays(gyro.valid, accelerometer.valid), axis=1), mean.shape)
            present = np.asarray(valid.reshape(runs, CLUSTERS, INSTRUMENTS, -1).all(axis=-1))
            # An axis without a reading says what the others say: it can neither alarm nor hide an alarm.
            others = np.matvec(self._cluster.gains[mask_index(present)], np.where(valid, mean, 0.0))
            mean = np.where(valid, mean, others @ self._cluster.H.T)
            samples = np.where(valid[..., None], samples, 0.0)
        readings = (mean / self._unit[:, None]).reshape(runs * CLUSTERS, -1)
        p_fa = settings.false_alarm_probability
        results = {
            "parity": parity.parity_test(self._reference, readings, p_fa, SUBJECTS),
            "glt": parity.glt_test(self._reference, readings, p_fa, SUBJECTS),
        }

        def columns(field: str) -> Array:
            table = [getattr(r, field) for test in results.values() for r in test]
            return np.moveaxis(
                np.stack(table).reshape(len(results), len(SUBJECTS), runs, CLUSTERS), (2, 3), (0, 2)
            ).reshape(runs, -1)

        driving = np.zeros((runs, CLUSTERS, INSTRUMENTS), bool)
        if settings.imu_driving_test != "none":
            named = [r.alarm for r in results[settings.imu_driving_test][1:]]
            driving = np.stack(named, axis=-1).reshape(runs, CLUSTERS, INSTRUMENTS)
        # Two instruments are the least that can be solved: while one is out, nobody else can be put out.
        out = (state.supervisor.health == supervisor.ISOLATED).reshape(runs, CLUSTERS, INSTRUMENTS)
        driving = driving & (out | ~out.any(axis=-1, keepdims=True))
        quiet = ~results["parity"][0].alarm.reshape(runs, CLUSTERS)
        supervision, decision = supervisor.step(
            state.supervisor,
            driving.reshape(runs, -1),
            np.repeat(quiet, INSTRUMENTS, axis=-1),
            np.ones((1, CLUSTERS * INSTRUMENTS), bool),
            rules,
        )
        used = decision.use.reshape(runs, CLUSTERS, INSTRUMENTS) & present
        # With fewer than two left (a second one without readings), all that are there are used in spite of everything.
        used = np.where(used.sum(axis=-1, keepdims=True) >= 2, used, present)
        now, before = mask_index(used), mask_index(state.used)
        both = np.stack([now, mask_index(present)], axis=1)
        body = np.swapaxes(self._cluster.gains[both] @ samples[:, None], -1, -2)
        change = self._cluster.gains[now] - self._cluster.gains[before]
        epoch = ImuEpoch(
            omega_b=body[:, :, 0],
            f_b=body[:, :, 1],
            parity=np.asarray(results["parity"][0].innovation).reshape(runs, CLUSTERS, -1) * self._unit[:, None],
            statistic=columns("statistic"),
            threshold=columns("threshold"),
            dof=columns("dof"),
            alarm=columns("alarm").astype(bool),
            decision=decision,
            used=used,
            changed=np.asarray((now != before).any(axis=-1)),
            bias_change=change @ change.swapaxes(-1, -2) * np.square(self._bias)[:, None, None],
            noise=self._cluster.covariances[both] * np.square(self._density)[:, None, None],
        )
        return ImuState(supervision, used), epoch
