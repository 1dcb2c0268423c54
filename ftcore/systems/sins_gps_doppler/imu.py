"""The redundant IMU as the navigator uses it: checked, reconfigured, solved for body rates and specific force.

Gyros and accelerometers are two clusters of the same geometry; arrays lead with ``(runs, 2)``. Detection works on the
mean over an epoch. The parity vector is calibrated before the flight (Zhang 1992 leaves the axis biases out; without a
calibration a healthy unit would alarm forever). Where the axes have scale-factor errors, which a rate or a specific
force excites, the calibration goes on in flight (:mod:`ftcore.detection.parity_calibration`).

What a healthy unit's parity vector is expected to be is taken off the readings, V' times it. It lies outside the
solution of all instruments, which does not change; but whichever instruments are left, their solution is then that of
all of them, to what is known of the parity vector: the biases of the solution do not jump with the instruments.

With an instrument out, isolated or without a reading, the two that are left have one parity equation between them: they
are watched by it, and if they disagree that is said, confirmed by the supervisor's m-of-n. Who of them it is cannot be
told, both explain it alike, so nobody is accused and both go on: two are the least that can be solved. If the one that
is out has recovered, all three tell: without the new culprit they would agree. Then it comes back, and the other goes.

While the instruments in use contradict each other, and nobody can be named, their noise is believed as large as the
parity vector says (:mod:`ftcore.detection.contradiction`): the filters open up, and the aids are listened to.

With readings of fewer than two instruments a direction is not measured: there the last value is held, and the noise
covariance grows by what that may miss (`HELD`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import contradiction, parity, parity_calibration, supervisor
from ftcore.detection.geometry import Cluster, mask_index
from ftcore.detection.parity import Isolation, Sight
from ftcore.earth import STANDARD_GRAVITY
from ftcore.readings import Group
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.forms import Settings

Array = NDArray[np.float64]
CLUSTERS, INSTRUMENTS = 2, 3
EVERY_CLUSTER = np.ones((1, CLUSTERS), bool)
ORDINARY = np.array([1.0, STANDARD_GRAVITY])
"""A rate and a specific force as they are flown [rad/s, m/s^2]."""
LEAST = 1e-5
"""What counts as noise, as a part of the other errors, where the noise itself is less."""
HELD = np.array([0.02, 1.0])
"""1-sigma of what a held angular rate [rad/s] and specific force [m/s^2] miss, anew each second: FTLab's choice."""


@dataclass(frozen=True)
class ImuState:
    """What the redundant IMU carries from one epoch to the next.

    Attributes:
        rest: supervisor of what the trusted instruments of each cluster say of each other.
        supervisor: supervisor of the six instruments.
        used: instruments used in the epoch before ``(runs, 2, 3)``.
        body: mean body rates [rad/s] and forces [m/s^2] of that epoch, protected and unprotected ``(runs, 2, 2, 3)``.
        series: epochs for which the instruments in use have contradicted each other ``(runs, 2)``.
        learned: what was learned of the clusters' errors, rows are runs times clusters; None where there is nothing to
            learn in flight.
    """

    rest: supervisor.State
    supervisor: supervisor.State
    used: Flags
    body: Array
    series: NDArray[np.int64]
    learned: parity_calibration.State | None


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
        sight, found: what parity space saw, and what each test says; rows are runs times clusters.
        rest: the test of those that are trusted while another one is out.
        decision: of the supervisor on ``(runs, 6)`` instruments.
        undecided: of the supervisor on ``(runs, 2)`` clusters; isolated means that the rest disagrees for certain.
        series: ``(runs, 2)`` epochs for which those in use have contradicted each other for certain.
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
    sight: Sight
    found: Mapping[str, Isolation]
    rest: Rest
    decision: supervisor.Decision
    undecided: supervisor.Decision
    series: NDArray[np.int64]
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
        scale: 1-sigma scale-factor error of the axes [1].
    """

    def __init__(
        self,
        cluster: Cluster,
        density: Array,
        bias: Array,
        calibration: Array,
        calibration_time: float,
        epoch: float,
        scale: float = 0.0,
    ) -> None:
        self._cluster = cluster
        self._epoch = epoch
        self._density = density
        # In units of its own noise a gyro is an accelerometer: one reference serves both, stacked along the runs.
        # Without noise to speak of, what is left of the other errors takes its place.
        least = np.maximum(LEAST * (bias + scale * ORDINARY), 1e-12)
        self._unit = np.maximum(density / math.sqrt(epoch), least)
        rest = (calibration / self._unit[:, None]).reshape(-1, cluster.axes)
        self._left = math.sqrt(epoch / calibration_time)
        self._reference = parity.calibrate(cluster, rest[:, None], 1.0, self._left)
        rows = len(calibration)
        self._scale = np.full(rows * CLUSTERS, scale)
        self._learned: parity_calibration.State | None = None
        if scale > 0.0:
            x = np.matvec(cluster.gains[-1], rest)
            own = np.tile(bias / self._unit, rows)
            self._learned = parity_calibration.start(cluster, rest, x, own, self._left, self._scale)

    def initial(self, runs: int) -> ImuState:
        """All instruments trusted."""
        return ImuState(
            supervisor.start(runs, CLUSTERS),
            supervisor.start(runs, CLUSTERS * INSTRUMENTS),
            np.ones((runs, CLUSTERS, INSTRUMENTS), bool),
            np.zeros((runs, 2, CLUSTERS, 3)),
            np.zeros((runs, CLUSTERS), np.int64),
            self._learned,
        )

    def step(
        self, state: ImuState, gyro: Group, accelerometer: Group, settings: Settings, rules: supervisor.Rules
    ) -> tuple[ImuState, ImuEpoch]:
        """One epoch of samples ``(runs, 6, samples)`` each."""
        samples = np.stack([gyro.values, accelerometer.values], axis=1)
        runs, cluster = len(samples), self._cluster
        mean = samples.mean(axis=-1)
        present: Flags = np.ones((runs, CLUSTERS, INSTRUMENTS), bool)
        if not (gyro.valid.all() and accelerometer.valid.all()):
            valid = np.broadcast_to(np.stack(np.broadcast_arrays(gyro.valid, accelerometer.valid), axis=1), mean.shape)
            present = np.asarray(valid.reshape(runs, CLUSTERS, INSTRUMENTS, -1).all(axis=-1))
            samples = np.where(valid[..., None], samples, 0.0)
        readings = (mean / self._unit[:, None]).reshape(runs * CLUSTERS, -1)
        p_fa = settings.false_alarm_probability
        everybody = bool(present.all())
        reference, expected = self._reference, None
        if state.learned is not None:
            known = mask_index((state.used & present).reshape(-1, INSTRUMENTS))
            x = np.matvec(self._cluster.gains[known], readings)
            expected = parity_calibration.expected(state.learned, self._cluster, x, self._scale)
            reference = parity_calibration.reference(self._reference, expected)
        sight = parity.look(reference, readings, p_fa, None if everybody else present.reshape(-1, INSTRUMENTS))
        found = {"parity": parity.by_plane(sight), "glt": parity.by_likelihood(sight)}

        def columns(of_set: NDArray[Any], field: str) -> NDArray[Any]:
            tables = [np.column_stack([of_set, getattr(test, field)]) for test in found.values()]
            return np.moveaxis(np.stack(tables).reshape(len(found), runs, CLUSTERS, -1), 0, 1).reshape(runs, -1)

        out = (state.supervisor.health == supervisor.ISOLATED).reshape(runs, CLUSTERS, INSTRUMENTS)
        trusted = present & ~out
        complete = trusted.all(axis=-1)
        rest, alarm = _rest(sight, readings, trusted, complete)
        driving = np.zeros((runs, CLUSTERS, INSTRUMENTS), bool)
        if settings.imu_driving_test != "none":
            driving = found[settings.imu_driving_test].alarm.reshape(runs, CLUSTERS, INSTRUMENTS)
        unnamed = alarm
        if settings.imu_driving_test != "none":
            nobody = contradiction.contradictory(sight).reshape(runs, CLUSTERS) & ~driving.any(axis=-1)
            unnamed = alarm | complete & nobody
        rest_supervision, undecided = supervisor.step(state.rest, unnamed, ~unnamed, EVERY_CLUSTER, rules)
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
        shape = (runs, CLUSTERS, cluster.axes)
        usual = np.broadcast_to(reference.bias @ cluster.V, (runs * CLUSTERS, cluster.axes)).reshape(shape)
        samples = samples - (usual * self._unit[:, None])[..., None]
        body = np.swapaxes(cluster.gains[both] @ samples[:, None], -1, -2)
        noise = cluster.covariances[both] * np.square(self._density)[:, None, None]
        blind = ~cluster.observable[both]
        if blind.any():
            unseen = np.where(blind[..., None, None], np.eye(3) - cluster.gains[both] @ cluster.H, 0.0)
            body = body + np.matvec(unseen, state.body)[..., None, :]
            noise = noise + unseen * np.square(HELD)[:, None, None]
        series = state.series
        if settings.imu_driving_test != "none":
            among = sight
            if not used.all():
                among = parity.look(reference, readings, p_fa, used.reshape(-1, INSTRUMENTS))
            more, series = contradiction.extra_variance(among, series.ravel())
            series = series.reshape(runs, CLUSTERS)
            if more.any():
                more = more.reshape(runs, CLUSTERS) * np.square(self._unit) * self._epoch
                noise[:, 0] += more[..., None, None] * cluster.covariances[now]
        change = (cluster.gains[now] - cluster.gains[before]) @ cluster.V.T
        learned = state.learned
        if learned is None or expected is None:
            spread = self._left**2 * np.eye(cluster.V.shape[0])
        else:
            spread = expected.spread.reshape(runs, CLUSTERS, *expected.spread.shape[1:])
            guilty = np.asarray(decision.just_isolated.reshape(-1, INSTRUMENTS).any(axis=-1))
            p = np.matvec(cluster.V, readings)
            learned = parity_calibration.learn(learned, expected, p, complete.reshape(-1), guilty)
        epoch = ImuEpoch(
            omega_b=body[:, :, 0],
            f_b=body[:, :, 1],
            parity=sight.p.reshape(runs, CLUSTERS, -1) * self._unit[:, None],
            statistic=columns(sight.FD, "statistic"),
            threshold=columns(sight.threshold, "threshold"),
            dof=columns(sight.dof, "dof"),
            alarm=columns(sight.alarm, "alarm"),
            sight=sight,
            found=found,
            rest=rest,
            decision=decision,
            undecided=undecided,
            series=series,
            used=used,
            changed=np.asarray((now != before).any(axis=-1)),
            bias_change=change @ spread @ change.swapaxes(-1, -2) * np.square(self._unit)[:, None, None],
            noise=noise,
        )
        return ImuState(rest_supervision, supervision, used, body.mean(axis=-2), series, learned), epoch


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
