"""The redundant IMU as the navigator uses it: checked, reconfigured, solved for body rates and specific force.

Gyros and accelerometers are two clusters of the same geometry; arrays lead with ``(runs, 2)``. Detection works on the
mean over an epoch. The parity vector is calibrated before the flight (000 leaves the axis biases out; without a
calibration a healthy unit would alarm forever).

With an instrument out, isolated or without a reading, the two that are left have one parity equation between them: they
are watched by it, and if they disagree that is said, confirmed by the supervisor's m-of-n. Who of them it is cannot be
told, both explain it alike, so nobody is accused and both go on: two are the least that can be solved. If the one that
is out has recovered, all three tell: without the new culprit they would agree. Then it comes back, and the other goes.

With readings of fewer than two instruments a direction is not measured: there the last value is held, and the noise
covariance grows by what that may miss (`HELD`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import parity, supervisor
from ftcore.detection.geometry import Cluster, mask_index
from ftcore.readings import Group
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.forms import Settings

Array = NDArray[np.float64]
CLUSTERS, INSTRUMENTS = 2, 3
EVERY_CLUSTER = np.ones((1, CLUSTERS), bool)
HELD = np.array([0.02, 1.0])
"""1-sigma of what a held angular rate [rad/s] and specific force [m/s^2] miss, anew each second: FTLab's choice."""


@dataclass(frozen=True)
class ImuState:
    """What the trusted instruments of each cluster were found to say of each other, the supervisor of the six, and
    which of them were used in the epoch before ``(runs, 2, 3)``; body rates and forces of that epoch, of the protected
    and the unprotected solution, mean over its samples ``(runs, 2, 2, 3)``."""

    rest: supervisor.State
    supervisor: supervisor.State
    used: Flags
    body: Array


@dataclass(frozen=True)
class Rest:
    """The trusted instruments of each cluster tested among themselves, ``(runs, 2)`` each; dof 0 while all are."""

    statistic: Array
    threshold: Array
    dof: NDArray[np.int64]
    alarm: Flags


@dataclass(frozen=True)
class ImuEpoch:
    """What the IMU gives the navigator.

    Attributes:
        omega_b, f_b: ``(runs, 2, samples, 3)``: protected (trusted instruments) and unprotected (all there are).
        parity: ``(runs, 2, 3)`` calibrated parity vectors.
        statistic, threshold, dof, alarm: ``(runs, 16)`` in the order of the description's IMU tests.
        rest: the test of those that are trusted while another one is out.
        decision: of the supervisor on ``(runs, 6)`` instruments.
        undecided: of the supervisor on ``(runs, 2)`` clusters; isolated means that the rest disagrees for certain.
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
    rest: Rest
    decision: supervisor.Decision
    undecided: supervisor.Decision
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
        return ImuState(
            supervisor.start(runs, CLUSTERS),
            supervisor.start(runs, CLUSTERS * INSTRUMENTS),
            np.ones((runs, CLUSTERS, INSTRUMENTS), bool),
            np.zeros((runs, 2, CLUSTERS, 3)),
        )

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
            samples = np.where(valid[..., None], samples, 0.0)
        readings = (mean / self._unit[:, None]).reshape(runs * CLUSTERS, -1)
        p_fa = settings.false_alarm_probability
        everybody = bool(present.all())
        sight = parity.look(self._reference, readings, p_fa, None if everybody else present.reshape(-1, INSTRUMENTS))
        found = {"parity": parity.by_plane(sight), "glt": parity.by_likelihood(sight)}

        def columns(of_set: NDArray[Any], field: str) -> NDArray[Any]:
            tables = [np.column_stack([of_set, getattr(test, field)]) for test in found.values()]
            return np.moveaxis(np.stack(tables).reshape(len(found), runs, CLUSTERS, -1), 0, 1).reshape(runs, -1)

        out = (state.supervisor.health == supervisor.ISOLATED).reshape(runs, CLUSTERS, INSTRUMENTS)
        trusted = present & ~out
        complete = trusted.all(axis=-1)
        rest, alarm = _rest(sight, readings, trusted, complete)
        rest_supervision, undecided = supervisor.step(state.rest, alarm, ~alarm, EVERY_CLUSTER, rules)
        driving = np.zeros((runs, CLUSTERS, INSTRUMENTS), bool)
        if settings.imu_driving_test != "none":
            driving = found[settings.imu_driving_test].alarm.reshape(runs, CLUSTERS, INSTRUMENTS)
        # Two instruments are the least that can be solved: while one is out, nobody else can be put out.
        driving = driving & (out | complete[..., None])
        # A long hold-off shall not keep out who is sound: it passes all of it with a probability of 90 % at least.
        p_pass = min(p_fa, 0.1 / rules.hold_off)
        back = parity.admission(sight, trusted.reshape(-1, INSTRUMENTS), alarm.reshape(-1), p_pass)
        supervision, decision = supervisor.step(
            state.supervisor,
            driving.reshape(runs, -1),
            back.reshape(runs, -1),
            np.ones((1, CLUSTERS * INSTRUMENTS), bool),
            rules,
        )
        used = decision.use.reshape(runs, CLUSTERS, INSTRUMENTS) & present
        # With fewer than two left (a second one without readings), all that are there are used in spite of everything.
        used = np.where(used.sum(axis=-1, keepdims=True) >= 2, used, present)
        now, before = mask_index(used), mask_index(state.used)
        both = np.stack([now, mask_index(present)], axis=1)
        body = np.swapaxes(self._cluster.gains[both] @ samples[:, None], -1, -2)
        noise = self._cluster.covariances[both] * np.square(self._density)[:, None, None]
        if not self._cluster.observable[both].all():
            unseen = np.eye(3) - self._cluster.gains[both] @ self._cluster.H
            body = body + np.matvec(unseen, state.body)[..., None, :]
            noise = noise + unseen * np.square(HELD)[:, None, None]
        change = self._cluster.gains[now] - self._cluster.gains[before]
        epoch = ImuEpoch(
            omega_b=body[:, :, 0],
            f_b=body[:, :, 1],
            parity=sight.p.reshape(runs, CLUSTERS, -1) * self._unit[:, None],
            statistic=columns(sight.FD, "statistic"),
            threshold=columns(sight.threshold, "threshold"),
            dof=columns(sight.dof, "dof"),
            alarm=columns(sight.alarm, "alarm"),
            rest=rest,
            decision=decision,
            undecided=undecided,
            used=used,
            changed=np.asarray((now != before).any(axis=-1)),
            bias_change=change @ change.swapaxes(-1, -2) * np.square(self._bias)[:, None, None],
            noise=noise,
        )
        return ImuState(rest_supervision, supervision, used, body.mean(axis=-2)), epoch


def _rest(sight: parity.Sight, readings: Array, trusted: Flags, complete: Flags) -> tuple[Rest, Flags]:
    """Test the trusted instruments ``(runs, 2, 3)`` where they are not all there are; with the alarm ``(runs, 2)``."""
    shape = complete.shape
    if complete.all():
        nothing, quiet = np.zeros(shape), np.zeros(shape, bool)
        return Rest(nothing, nothing, np.zeros(shape, np.int64), quiet), quiet
    among = parity.look(sight.reference, readings, sight.p_fa, trusted.reshape(-1, INSTRUMENTS))
    dof = np.where(complete, 0, among.dof.reshape(shape))
    alarm = among.alarm.reshape(shape) & ~complete
    return Rest(among.FD.reshape(shape), among.threshold.reshape(shape), dof, alarm), alarm
