"""Estimation and detection of the SINS/GPS/Doppler system: sees readings only.

One epoch, in the order of the code: the redundant IMU is checked and solved; two strapdowns fly on, the protected one
with the trusted instruments and the unprotected one with all; a bank of filters is carried over; wrong satellites are
left out, if that is asked for; the tests compare measurements with predictions; the supervisor decides; the local
filters take the trusted measurements and the master fuses them. Feed-forward: the strapdowns run free, the filters
estimate their errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore import units
from ftcore.detection import chi_square, supervisor
from ftcore.detection.geometry import Cluster, three_two_dof
from ftcore.estimation import federated, ins_error, kalman
from ftcore.estimation.federated import Estimate, Sharing
from ftcore.estimation.strapdown import InsState, damp_vertical, damping_gains, propagate
from ftcore.readings import Readings
from ftcore.systems.base import Controls, Flags, Notice, Output
from ftcore.systems.sins_gps_doppler import aids, bank, masters, satellites
from ftcore.systems.sins_gps_doppler.aid_tests import AidTestResult, AidTests, AidTestState
from ftcore.systems.sins_gps_doppler.aids import Aid
from ftcore.systems.sins_gps_doppler.bank import ALONE, CENTRAL, FUSED, LOCAL, NEWER, PRIOR, REFERENCE, Filters
from ftcore.systems.sins_gps_doppler.forms import Parameters, Settings
from ftcore.systems.sins_gps_doppler.imu import ImuEpoch, ImuState, RedundantImu
from ftcore.systems.sins_gps_doppler.masters import Fused
from ftcore.systems.sins_gps_doppler.names import AID_TESTS, AIDS, CLUSTERS, EPOCH, SLOTS
from ftcore.systems.sins_gps_doppler.reporter import Detail
from ftcore.systems.sins_gps_doppler.satellites import SatelliteState

Array = NDArray[np.float64]
SUBJECTS = tuple(AIDS)


@dataclass(frozen=True)
class NavigatorState:
    """Everything the navigator carries from epoch to epoch.

    Attributes:
        ins: protected and unprotected strapdown, leading axes ``(2 runs,)``, run-major.
        sound: ``(runs,)`` epochs since the propagators took turns, or since anybody was last suspected, in which the
            fused estimate took a measurement in.
    """

    ins: InsState
    filters: Filters
    imu: ImuState
    satellites: SatelliteState
    tests: AidTestState
    supervisor: supervisor.State
    members: Flags
    sharing: Sharing
    sound: NDArray[np.int64]


class Navigator:
    """See :class:`ftcore.systems.base.Navigator`."""

    def __init__(
        self,
        p: Parameters,
        cluster: Cluster,
        runs: int,
        alignment: InsState,
        calibration: tuple[Array, Array],
    ) -> None:
        self._p = p
        self._runs = runs
        self._alignment = alignment
        i, a = p.inertial, p.aiding
        density = np.array(
            [units.to_si(i.angle_random_walk, "deg/sqrt(h)"), units.to_si(i.accelerometer_noise, "ug/sqrt(Hz)")]
        )
        bias = np.array([units.to_si(i.gyro_bias, "deg/h"), units.to_si(i.accelerometer_bias, "ug")])
        self._imu = RedundantImu(cluster, density, bias, np.stack(calibration, axis=1), i.calibration, EPOCH)
        self._P0 = _initial_covariance(p, cluster, bias)
        self._gains = damping_gains(a.vertical_damping, p.flight.height)
        self._tests = AidTests(runs, ins_error.STATES)

    @staticmethod
    def geometry(p: Parameters) -> Cluster:
        """Three 2-DOF instruments at the mounting angles."""
        phi, theta, psi = (math.radians(angle) for angle in p.inertial.mounting)
        return three_two_dof(phi, theta, psi)

    def initial(self, controls: Controls) -> NavigatorState:
        """Before the first epoch: aligned, everybody trusted."""
        sharing = _sharing(controls.settings)
        twice = InsState(
            *(np.repeat(v, 2, axis=0) for v in (self._alignment.lla, self._alignment.v_n, self._alignment.C_nb))
        )
        return NavigatorState(
            ins=twice,
            filters=bank.start(self._runs, self._P0, sharing),
            imu=self._imu.initial(self._runs),
            satellites=satellites.start(self._runs),
            tests=self._tests.initial(),
            supervisor=supervisor.start(self._runs, len(SUBJECTS)),
            members=np.ones((1, len(SUBJECTS)), bool),
            sharing=sharing,
            sound=np.zeros(self._runs, np.int64),
        )

    def step(self, state: NavigatorState, readings: Readings, controls: Controls) -> tuple[NavigatorState, Output]:
        """One epoch."""
        settings: Settings = controls.settings
        runs = self._runs
        rules = supervisor.Rules(settings.confirm, settings.within, 1, settings.hold_off)
        imu_state, imu = self._imu.step(state.imu, readings["imu.gyro"], readings["imu.accelerometer"], settings, rules)
        ins, Phi, Q = self._fly(state.ins, imu, readings, controls)

        sharing = _sharing(settings)
        filters = state.filters
        if sharing != state.sharing:
            known = filters.estimate(FUSED)
            fresh = federated.start(known.x, known.P, sharing)
            filters = bank.replaced(filters, {i: (fresh.x[:, i], fresh.P[:, i]) for i in range(3)})
        filters = bank.predict(filters, Phi, Q, sharing, state.members)
        filters = _bias_jump(filters, imu, federated.noise_factors(sharing, state.members))

        received, lines = aids.gps(self._p.aiding, ins, readings, runs, controls.enabled["gps"])
        satellite_state, integrity = satellites.step(state.satellites, received, filters, settings, rules)
        gps = integrity.gps
        doppler = aids.doppler(self._p.aiding, ins, readings, runs, controls.enabled["doppler"])
        x, P = filters.x.copy(), filters.P.copy()
        references = [FUSED, REFERENCE]
        updates, predictions = [], []
        for j, aid in enumerate((gps, doppler)):
            predictions.append(
                kalman.innovation(filters.x[:, references], filters.P[:, references], *aid.of(references))
            )
            taking = [ALONE[j], LOCAL[j], CENTRAL]
            update = kalman.update(x[:, taking], P[:, taking], *aid.of(taking))
            x[:, taking], P[:, taking] = update.x, update.P
            updates.append(update)

        tests_state, tests = self._tests.step(
            state.tests,
            updates,
            predictions,
            [gps, doppler],
            Phi[:, 0],
            Filters(x, P),
            settings.false_alarm_probability,
        )
        driving = np.zeros((runs, 2), bool)
        if settings.driving_test != "none":
            driving = tests.alarm.reshape(runs, len(AID_TESTS), 2)[:, AID_TESTS.index(settings.driving_test)]
        enabled = np.array([[controls.enabled["gps"], controls.enabled["doppler"]]])
        has_reading = np.stack([np.broadcast_to(u.dof[:, 0] > 0, (runs,)) for u in updates], axis=-1)
        admission = np.stack([p.statistic[:, 0] for p in predictions], axis=-1)
        limit = chi_square.threshold(
            settings.false_alarm_probability,
            np.stack([np.broadcast_to(p.dof[:, 0], (runs,)) for p in predictions], axis=-1),
        )
        supervision, decision = supervisor.step(
            state.supervisor, driving, (admission <= limit) & has_reading, enabled, rules
        )

        used, back = decision.use, decision.just_readmitted
        made = masters.fuse(settings, sharing, filters, Filters(x, P), (gps, doppler), decision, has_reading, tests)
        fused = made.estimate
        x[:, :3], P[:, :3] = made.federation.x, made.federation.P
        x[:, FUSED], P[:, FUSED] = fused.x, fused.P
        filters, sound = _take_turns(
            Filters(x, P), fused, state.sound, decision, used & has_reading, settings.propagator_period
        )
        for j in range(2):
            filters = bank.reset_where(filters, (ALONE[j], PRIOR[j]), back[:, j], fused)
        if back.any():
            tests_state = self._tests.reset(tests_state, back)

        after = NavigatorState(
            ins, filters, imu_state, satellite_state, tests_state, supervision, decision.members, sharing, sound
        )
        detail = self._detail(readings, ins, filters, made, imu, gps, doppler, lines)
        feeding = used & has_reading
        by_part = (tests, imu, imu.rest, integrity)  # in the order of the description's tests
        statistic, threshold, dof, alarm = (
            np.concatenate([getattr(part, field) for part in by_part], axis=-1)
            for field in ("statistic", "threshold", "dof", "alarm")
        )
        judged = dof > 0  # a test without a reading has no statistic: a gap, not a zero
        output = Output(
            statistic=np.where(judged, statistic, np.nan),
            threshold=np.where(judged, threshold, np.nan),
            dof=dof,
            alarm=alarm,
            health=np.concatenate([decision.health, imu.decision.health, integrity.health], axis=-1).astype(np.int8),
            used=np.concatenate([feeding, imu.used.reshape(runs, -1), integrity.used & feeding[:, :1]], axis=-1),
            notices=[*integrity.notices, *_notices(decision, imu, tests)],
            detail=detail,
        )
        return after, output

    # ---- parts of an epoch ----------------------------------------------------------------------------------------

    def _fly(
        self, ins: InsState, imu: ImuEpoch, readings: Readings, controls: Controls
    ) -> tuple[InsState, Array, Array]:
        """Both strapdowns over one epoch, with their transition and noise ``(runs, 2, 21, 21)``."""
        runs, samples = self._runs, imu.omega_b.shape[2]
        omega_b, f_b = imu.omega_b.reshape(2 * runs, samples, 3), imu.f_b.reshape(2 * runs, samples, 3)
        ins, interval = propagate(ins, omega_b, f_b, EPOCH / samples)
        a = self._p.aiding
        baro = readings["altimeter.height"]
        on = np.repeat(np.broadcast_to(baro.valid[:, 0] & controls.enabled["altimeter"], (runs,)), 2)
        k1, k2 = (gain * on for gain in self._gains)
        height = np.repeat(np.where(np.isfinite(baro.values[:, 0]), baro.values[:, 0], 0.0), 2)
        noise = imu.noise.reshape(2 * runs, 2, 3, 3)
        densities = ins_error.NoiseDensities(
            gyro=noise[:, 0],
            accelerometer=noise[:, 1],
            clock_phase=a.clock_phase_noise,
            clock_frequency=a.clock_frequency_noise,
        )
        F = ins_error.system_matrix(interval)
        # The altimeter's own height, not the strapdown's: that one wanders by 100 m while it is being damped, and with
        # it bias and scale factor would look separable in level flight, which they are not.
        D = ins_error.damping_transition(height, EPOCH, k1, k2)
        Phi = D @ ins_error.transition(F, EPOCH)
        Q = D @ ins_error.process_noise(F, ins_error.noise_density(interval, densities), EPOCH) @ D.swapaxes(-1, -2)
        Q = Q + ins_error.damping_noise(EPOCH, k1, k2, a.altimeter_noise)
        shape = (runs, 2, ins_error.STATES, ins_error.STATES)
        ins = damp_vertical(ins, height, EPOCH, k1, k2)
        return ins, Phi.reshape(shape), Q.reshape(shape)

    def _detail(
        self,
        readings: Readings,
        ins: InsState,
        filters: Filters,
        made: Fused,
        imu: ImuEpoch,
        gps: Aid,
        doppler: Aid,
        lines: Array,
    ) -> Detail:
        runs = self._runs
        shown, fused = [FUSED, *ALONE, CENTRAL], made.estimate
        two = InsState(ins.lla.reshape(runs, 2, 3), ins.v_n.reshape(runs, 2, 3), ins.C_nb.reshape(runs, 2, 3, 3))
        n = len(gps.columns) // 2
        there, taken = gps.present[:, :n], gps.valid[:, :n]
        discrepancy = np.full((runs, len(SLOTS)), np.nan)
        residual = gps.y[:, 0, :n] - np.matvec(gps.H[:, 0, :n], fused.x)
        discrepancy[:, gps.columns[:n]] = np.where(there, residual, np.nan)
        reading = np.where(doppler.present, readings["doppler.velocity"].values, np.nan)
        output, _ = federated.failed_output(fused, doppler.H[:, 0])
        indicated = doppler.y[:, 0] + np.nan_to_num(reading)
        return Detail(
            ins=two,
            x=filters.x[:, shown, :9],
            P=filters.P[:, shown, :9, :9],
            parity=imu.parity,
            doppler=np.stack([reading, indicated - output], axis=1),
            discrepancy=discrepancy,
            lines=lines,
            in_use=np.broadcast_to(taken.sum(axis=-1).astype(float), (runs,)),
            excluded=np.broadcast_to((there & ~taken).sum(axis=-1).astype(float), (runs,)),
            hdop=aids.hdop(gps),
            weights=made.weights,
        )


def _sharing(settings: Settings) -> Sharing:
    if settings.fusion_mode == "rescale":
        third = 1.0 / 3.0
        rest = 1.0 - third
        return Sharing("rescale", (rest * settings.gps_share, rest * (1.0 - settings.gps_share)), third)
    return Sharing(settings.fusion_mode, (settings.gps_share, 1.0 - settings.gps_share))


def _initial_covariance(p: Parameters, cluster: Cluster, bias: Array) -> Array:
    """P(0) ``(21, 21)``: alignment, sensor repeatability, altimeter, Doppler, clock."""
    n, a = p.initial, p.aiding
    P0 = np.zeros((ins_error.STATES, ins_error.STATES))
    sigma = [n.position] * 3 + [n.velocity] * 3 + [n.tilt, n.tilt, n.azimuth] + [0.0] * 6
    sigma += [a.altimeter_bias, a.altimeter_scale, a.doppler_scale, a.doppler_drift, n.clock_phase, n.clock_frequency]
    # A state that is known exactly keeps a hair of variance, so that every covariance has an inverse.
    floor = np.array([1e-6] * 6 + [1e-12] * 3 + [1e-14] * 3 + [1e-9] * 3 + [1e-6, 1e-9, 1e-9, 1e-9, 1e-6, 1e-6])
    P0[np.diag_indices_from(P0)] = np.maximum(np.array(sigma), floor) ** 2
    body = cluster.covariances[-1]
    P0[9:12, 9:12] += body * bias[0] ** 2
    P0[12:15, 12:15] += body * bias[1] ** 2
    return P0


def _take_turns(
    filters: Filters, fused: Estimate, sound: NDArray[np.int64], decision: supervisor.Decision, fed: Flags, period: int
) -> tuple[Filters, NDArray[np.int64]]:
    """The propagators' turn, in the runs where it is due: the newer becomes the reference, the other starts anew.

    It starts from a fused estimate that nobody had any doubts about: only after ``period`` epochs in which somebody fed
    it, ``fed (runs, 2)``, and nobody was suspected; until then the reference grows older, as its covariance says. And
    what the newer one took over before a culprit was found may be contaminated, so it is taken back: both go on from
    the reference. 002 resets them every 30 s whatever happens; then a drift that is found too late makes the test of
    every *other* sensor alarm a period later.
    """
    sound = np.where((decision.suspect | decision.just_isolated).any(axis=-1), 0, sound + fed.any(axis=-1))
    caught, due = np.asarray(decision.just_isolated.any(axis=-1)), sound >= period
    if caught.any():
        filters = bank.reset_where(filters, (NEWER,), caught, filters.estimate(REFERENCE))
    if due.any():
        filters = bank.reset_where(filters, (REFERENCE,), due, filters.estimate(NEWER))
        filters = bank.reset_where(filters, (NEWER,), due, fused)
    return filters, np.where(due, 0, sound)


def _bias_jump(filters: Filters, imu: ImuEpoch, factors: Array) -> Filters:
    """A changed set of instruments has other body biases: tell the filters on the protected strapdown by how much.

    The jump is common to all of them, so the federation's filters get it with the shares of process noise, ``factors``.
    """
    if not imu.changed.any():
        return filters
    P = filters.P.copy()
    protected = np.flatnonzero(bank.INS_OF_FILTER == 0)
    share = np.ones((len(P), len(protected), 1, 1))
    share[:, :3, 0, 0] = factors
    for cluster, block in ((0, slice(9, 12)), (1, slice(12, 15))):
        P[:, protected, block, block] += share * imu.bias_change[:, None, cluster]
    return Filters(filters.x, P)


def _notices(decision: supervisor.Decision, imu: ImuEpoch, tests: AidTestResult) -> list[Notice]:
    notices = []
    for j, subject in enumerate(SUBJECTS):
        back, out = decision.just_readmitted[:, j], decision.just_isolated[:, j]
        if back.any():
            notices.append(Notice("filter.reset", subject, back, {}))
        if out.any():
            for column in np.unique(tests.culprit[out, j]):
                if column >= 0:
                    where = out & (tests.culprit[:, j] == column)
                    part, unit = _channel(subject, int(column))
                    numbers = {f"estimated_fault [{unit}]": tests.size[:, j]}
                    notices.append(Notice("channel.named", f"{subject}.{part}", where, numbers))
    names = tuple(CLUSTERS)
    for c, cluster in enumerate(names):
        for kind, where in (
            ("integrity.cannot-isolate", imu.undecided.just_isolated[:, c]),
            ("integrity.restored", imu.undecided.just_readmitted[:, c]),
        ):
            if where.any():
                numbers = {"statistic": imu.rest.statistic[:, c], "threshold": imu.rest.threshold[:, c]}
                notices.append(Notice(kind, f"imu.{cluster}", where, numbers))
    if imu.changed.any():
        numbers = {f"{name}s_used": imu.used[:, c].sum(axis=-1).astype(float) for c, name in enumerate(names)}
        notices.append(Notice("imu.reconfigured", "imu", imu.changed, numbers))
    return notices


def _channel(subject: str, column: int) -> tuple[str, str]:
    """Part and unit behind a measurement column."""
    if subject == "gps":
        return SLOTS[column % len(SLOTS)], "m" if column < len(SLOTS) else "m/s"
    return "xyz"[column], "m/s"
