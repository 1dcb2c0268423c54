"""Estimation and detection of the SINS/GPS/Doppler system: sees readings only.

One epoch, in the order of the code: the redundant IMU is checked and solved; two strapdowns fly on, the protected one
with the trusted instruments and the unprotected one with all; a bank of filters is carried over; the altimeter is
judged, and damps the strapdowns if it is trusted; wrong satellites are left out, if that is asked for; the tests
compare measurements with predictions; the supervisor decides; the local filters take the trusted measurements and the
master fuses them. Feed-forward: the strapdowns run free, the filters
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
from ftcore.estimation.federated import Sharing
from ftcore.estimation.strapdown import InsState, damping_gains
from ftcore.parts import navigation
from ftcore.parts.ledger import Layout, Ledger
from ftcore.readings import Readings
from ftcore.systems.base import Controls, Flags, Output
from ftcore.systems.reporting import output
from ftcore.systems.sins_gps_doppler import (
    aid_tests,
    aids,
    altimeter,
    bank,
    filtering,
    hindsight,
    history,
    inertial,
    masters,
    notices,
    overruled,
    satellites,
    strapdowns,
)
from ftcore.systems.sins_gps_doppler.aid_tests import AidTests, AidTestState
from ftcore.systems.sins_gps_doppler.aids import AIDS
from ftcore.systems.sins_gps_doppler.altimeter import AltimeterState
from ftcore.systems.sins_gps_doppler.bank import ALONE, CENTRAL, FUSED, REFERENCE, WITNESS, Filters
from ftcore.systems.sins_gps_doppler.estimators import CORRECTS
from ftcore.systems.sins_gps_doppler.filtering import Turns
from ftcore.systems.sins_gps_doppler.forms import EPOCH, Parameters, Settings
from ftcore.systems.sins_gps_doppler.history import History
from ftcore.systems.sins_gps_doppler.imu import ImuState, RedundantImu
from ftcore.systems.sins_gps_doppler.satellites import SatelliteState
from ftcore.systems.two_axis import unpaired

Array = NDArray[np.float64]
SUBJECTS = tuple(AIDS)
LEAST_NOISE = 0.01
"""Metres that the altimeter's noise is believed to be at least."""


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
    altimeter: AltimeterState
    tests: AidTestState
    supervisor: supervisor.State
    members: Flags
    sharing: Sharing
    master: str
    sound: NDArray[np.int64]
    history: History
    overruled: overruled.State


class Navigator:
    """See :class:`ftcore.systems.base.Navigator`."""

    def __init__(
        self,
        p: Parameters,
        cluster: Cluster,
        runs: int,
        alignment: InsState,
        calibration: tuple[Array, Array],
        layout: Layout,
    ) -> None:
        self._layout = layout
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
        self._biases = np.zeros_like(self._P0)
        self._biases[9:15, 9:15] = self._P0[9:15, 9:15]
        self._gains = damping_gains(a.vertical_damping, p.flight.height)
        # A noise that is set to nothing would leave the witness nothing to weigh readings by.
        self._altimeter_variance = max(a.altimeter_noise, LEAST_NOISE) ** 2
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
            altimeter=altimeter.start(self._runs),
            tests=self._tests.initial(),
            supervisor=supervisor.start(self._runs, len(SUBJECTS)),
            members=np.ones((1, len(SUBJECTS)), bool),
            sharing=sharing,
            master=controls.settings.master,
            sound=np.zeros(self._runs, np.int64),
            history=history.start(self._runs),
            overruled=overruled.start(self._runs),
        )

    def step(self, state: NavigatorState, readings: Readings, controls: Controls) -> tuple[NavigatorState, Output]:
        """One epoch."""
        settings: Settings = controls.settings
        runs = self._runs
        rules = supervisor.Rules(settings.confirm, settings.within, 1, settings.hold_off)
        imu_state, imu = self._imu.step(state.imu, readings["imu.gyro"], readings["imu.accelerometer"], settings, rules)
        ins, motion = strapdowns.fly(state.ins, imu)
        Phi, Q = strapdowns.matrices(motion, self._p.aiding)

        sharing = _sharing(settings)
        filters = state.filters
        if sharing != state.sharing:
            known = filters.estimate(FUSED)
            fresh = federated.start(known.x, known.P, sharing)
            filters = bank.replaced(filters, {i: (fresh.x[:, i], fresh.P[:, i]) for i in range(3)})
        anew = sharing != state.sharing or settings.master != state.master
        past = history.keep(state.history, filters, anew)
        filters = bank.predict(filters, Phi, Q, sharing, state.members)
        factors = federated.noise_factors(sharing, state.members)
        filters = filtering.bias_jump(filters, imu.changed, imu.bias_change, factors)
        opening = state.overruled.opening
        filters = overruled.reopen(filters, opening, self._biases, factors)

        damping = strapdowns.altimeter(ins, readings, controls.enabled["altimeter"])
        altimeter_state, judged = altimeter.judge(
            state.altimeter,
            filters.estimate(WITNESS),
            damping,
            self._altimeter_variance,
            controls.enabled["altimeter"],
            settings,
            rules,
        )
        filters = bank.reopen_bias(filters, judged.opened, judged.shift, factors)
        damping = damping.trusted(judged.used, self._gains)
        ins = strapdowns.damp(ins, damping)
        filters = bank.damp(filters, damping, self._altimeter_variance, factors)
        Phi_damped = strapdowns.damped(Phi[:, 0], damping)

        received, lines = aids.gps(self._p.aiding, ins, readings, runs, controls.enabled["gps"])
        satellite_state, integrity = satellites.step(state.satellites, received, filters, settings, rules)
        gps = integrity.gps
        doppler = aids.doppler(self._p.aiding, ins, readings, runs, controls.enabled["doppler"])
        references = [FUSED, REFERENCE]
        predictions = [
            kalman.innovation(filters.x[:, references], filters.P[:, references], *aid.of(references))
            for aid in (gps, doppler)
        ]
        updated, updates = filtering.measure(filters, (gps, doppler))
        tests_state, tests = self._tests.step(
            state.tests,
            updates,
            predictions,
            [gps, doppler],
            Phi_damped,
            updated,
            settings.false_alarm_probability,
        )
        driving = np.zeros((runs, 2), bool)
        if settings.driving_test != "none":
            driving = tests.found[settings.driving_test].alarm
        enabled = np.array([[controls.enabled["gps"], controls.enabled["doppler"]]])
        has_reading = np.stack([np.broadcast_to(u.dof[:, 0] > 0, (runs,)) for u in updates], axis=-1)
        admission = np.stack([p.statistic[:, 0] for p in predictions], axis=-1)
        limit = chi_square.threshold(
            settings.false_alarm_probability,
            np.stack([np.broadcast_to(p.dof[:, 0], (runs,)) for p in predictions], axis=-1),
        )
        supervision, decision = supervisor.step(
            overruled.taken_back(state.supervisor, opening), driving, (admission <= limit) & has_reading, enabled, rules
        )

        back = decision.just_readmitted
        decided = masters.verdict(settings, decision, has_reading, tests)
        feeding = decided.use & has_reading
        sound, turns = _turns(state.sound, decision, feeding, settings.propagator_period)
        prior = filters
        filters, made = filtering.conclude(settings, sharing, filters, updated, (gps, doppler), decided, turns)
        past = history.remember(
            past,
            history.Epoch(
                settings,
                sharing,
                (controls.enabled["gps"], controls.enabled["doppler"]),
                motion,
                damping,
                ins,
                imu.changed,
                imu.bias_change,
                opening,
                judged.opened,
                judged.shift,
                history.light(readings),
                np.broadcast_to(state.members, (runs, 2)),
                integrity.used,
                decided,
                turns,
                np.zeros((runs, 3), bool),
            ),
            tests,
            tests_state.cusum,
            predictions,
            driving,
        )
        past, filters, culprits = hindsight.review(
            past,
            filters,
            decision.just_isolated,
            (integrity.health == supervisor.ISOLATED) & (state.satellites.supervisor.health != supervisor.ISOLATED),
            (judged.decision.just_isolated[:, 0], judged.age),
            self._p.aiding,
            self._altimeter_variance,
            self._biases,
        )
        # A filter that was flown again has another past than what its tests remember.
        renewed = back if culprits is None else back | culprits.renewed
        if renewed.any():
            tests_state = self._tests.reset(tests_state, renewed)

        after = NavigatorState(
            ins,
            filters,
            imu_state,
            satellite_state,
            altimeter_state,
            tests_state,
            supervision,
            decision.members,
            sharing,
            settings.master,
            sound,
            past,
            overruled.judge(state.overruled, prior, (gps, doppler), has_reading, decision.isolated, imu),
        )
        say = Ledger(self._layout, runs)
        inertial.report(say, imu)
        altimeter.report(say, judged, damping.present)
        satellites.report(say, integrity, feeding[:, 0], lines)
        aids.report(say, gps, doppler, readings, filters.estimate(FUSED))
        aid_tests.report(say, tests)
        say.judge("{aid}", decision.health, feeding)
        say["used.{aid}"] = feeding
        masters.report(say, made)
        two = InsState(ins.lla.reshape(runs, 2, 3), ins.v_n.reshape(runs, 2, 3), ins.C_nb.reshape(runs, 2, 3, 3))
        shown = [FUSED, *ALONE, CENTRAL]
        navigation.report(say, two, CORRECTS, filters.x[:, shown, :9], filters.P[:, shown, :9, :9])
        events = (
            *integrity.notices,
            *notices.of_aids(decision, tests),
            *notices.of_imu(imu),
            *notices.reopened(opening),
            *notices.of_altimeter(judged),
            *notices.flown_again(past, culprits),
        )
        return after, output(say, events, left_out=unpaired(readings, ("imu.gyro", "imu.accelerometer")))


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


def _turns(
    sound: NDArray[np.int64], decision: supervisor.Decision, fed: Flags, period: int
) -> tuple[NDArray[np.int64], Turns]:
    """The propagators' turn, in the runs where it is due: the newer becomes the reference, the other starts anew.

    It starts from a fused estimate that nobody had any doubts about: only after ``period`` epochs in which somebody fed
    it, ``fed (runs, 2)``, and nobody was suspected; until then the reference grows older, as its covariance says. And
    what the newer one took over before a culprit was found may be contaminated, so it is taken back: both go on from
    the reference. Yang 2016 resets them every 30 s whatever happens; then a drift that is found too late makes the test
    of every *other* sensor alarm a period later.
    """
    sound = np.where((decision.suspect | decision.just_isolated).any(axis=-1), 0, sound + fed.any(axis=-1))
    due = sound >= period
    return np.where(due, 0, sound), Turns(np.asarray(decision.just_isolated.any(axis=-1)), due)
