"""Estimation and detection of the SINS/GPS/BD2/CNS system: sees readings only.

One epoch, in the order of the code: the IMU is read (and checked, if it is the redundant one); the strapdown flies on,
with its sensor errors as known so far; the filters are carried over; every aid is tested against the older of two
propagators; the eight subsets of aids are fused by what the tests say; now and then a propagator is reset, and the
strapdown corrected. All filters estimate the errors of the same strapdown, also those that had no part in correcting
it: a correction moves the origin of them all. With the redundant IMU the unprotected filter has a strapdown of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftcore import units
from ftcore.detection import supervisor
from ftcore.estimation import imm, ins_error, kalman
from ftcore.estimation.imm import Mixture
from ftcore.estimation.strapdown import InsState, propagate
from ftcore.parts import instruments, navigation
from ftcore.parts.instruments import CLUSTERS
from ftcore.parts.ledger import Layout, Ledger
from ftcore.readings import Readings
from ftcore.systems.base import Controls, Notice, Output
from ftcore.systems.past import notices as flown_again
from ftcore.systems.reporting import output
from ftcore.systems.sins_gps_bd2_cns import aid_tests, aids, bank, hindsight, measurements, protected, weights
from ftcore.systems.sins_gps_bd2_cns import branch as fault_tolerant
from ftcore.systems.sins_gps_bd2_cns.aids import AIDS, READINGS
from ftcore.systems.sins_gps_bd2_cns.branch import STARS, Branch, Examined, Measured, Motion
from ftcore.systems.sins_gps_bd2_cns.error_model import ErrorModel, Flown
from ftcore.systems.sins_gps_bd2_cns.estimators import ESTIMATORS
from ftcore.systems.sins_gps_bd2_cns.forms import EPOCH, Parameters, Settings
from ftcore.systems.sins_gps_bd2_cns.hindsight import Hindsight, History, Review
from ftcore.systems.sins_gps_bd2_cns.imu import Epoch as ImuEpoch
from ftcore.systems.sins_gps_bd2_cns.imu import Imu
from ftcore.systems.sins_gps_bd2_cns.imu import State as ImuState
from ftcore.systems.sins_gps_bd2_cns.protected import Epoch, Outcome, Protected
from ftcore.systems.sins_gps_doppler.imu import ImuEpoch as RedundantEpoch

Array = NDArray[np.float64]
N = ins_error.CORE_STATES
BIASES = slice(9, 15)
LEARNING = 30.0
"""Seconds in which the filters take a constant error of a gyro for its drift."""


@dataclass(frozen=True)
class NavigatorState:
    """Everything the navigator carries from epoch to epoch.

    Attributes:
        ins: strapdown, leading axes ``(S runs,)``, run-major: protected and, with the redundant IMU, unprotected.
        bias: gyro drift and accelerometer bias that the strapdown subtracts, ``(runs, S, 6)``.
        learned, reach: of the protected strapdown, by how much what was learned has turned it ``(runs, 3)`` [rad], and
            how its attitude answers to the data sheet of the gyros ``(runs, 3, 6)``; see :class:`Motion`.
        usual: body rates of late ``(runs, 3)`` [rad/s]: what their scale factors make of them is taken for gyro drift.
        protected: fault-tolerant filter with IMM, and who is trusted.
        conventional: fault-tolerant filter without IMM.
        unprotected: IMM of all aids without any test, ``(runs, 2, ...)``.
        alone: IMMs of one aid each, ``(runs, 3, 2, ...)``.
        alternated, corrected: epochs since the propagators took turns, since the strapdown was corrected.
    """

    ins: InsState
    bias: Array
    learned: Array
    reach: Array
    usual: Array
    imu: ImuState
    protected: Protected
    conventional: Branch
    unprotected: Mixture
    alone: Mixture
    alternated: int
    corrected: int
    history: History


class Navigator:
    """See :class:`ftcore.systems.base.Navigator`."""

    def __init__(
        self,
        p: Parameters,
        chart: measurements.Chart,
        runs: int,
        alignment: InsState,
        calibration: Array,
        layout: Layout,
    ) -> None:
        self._layout = layout
        self._p = p
        self._chart = chart
        self._runs = runs
        self._alignment = alignment
        self._imu = Imu(p, runs, calibration)
        m = p.models
        self._mu = np.array([1.0 - m.start_large, m.start_large])
        self._transition = imm.transition_matrix([[m.stay, 1.0 - m.stay], [1.0 - m.stay, m.stay]])
        cns = units.to_si(p.aiding.cns, "arcsec")
        self._R = np.square(np.array([*p.aiding.gps, *p.aiding.bd2, cns, cns, cns]))
        self._model = ErrorModel(p, self._imu)
        self._hindsight = Hindsight(runs, self._model, self._R, self._transition)
        self._gyro_bias = np.linalg.cholesky(self._imu.bias_covariance()[0])
        self._scale_factor = units.to_si(p.inertial.scale_factor, "ppm")

    def initial(self, controls: Controls) -> NavigatorState:
        """Before the first epoch: aligned, everybody trusted."""
        runs, S = self._runs, self._imu.solutions
        a = self._alignment
        x = np.zeros((runs, N))
        P = np.broadcast_to(self._model.initial_covariance(), (runs, N, N))
        start = imm.start(x, P, self._mu)
        return NavigatorState(
            ins=InsState(*(np.repeat(v, S, axis=0) for v in (a.lla, a.v_n, a.C_nb))),
            bias=np.zeros((runs, S, 6)),
            learned=np.zeros((runs, 3)),
            reach=np.zeros((runs, 3, 6)),
            usual=np.zeros((runs, 3)),
            imu=self._imu.initial(),
            protected=Protected(
                fault_tolerant.start(x, P, self._mu), supervisor.start(runs, len(AIDS)), None, np.zeros((runs, 3, 6))
            ),
            conventional=fault_tolerant.start(x, P, np.ones(1)),
            unprotected=start,
            alone=Mixture(*(np.repeat(v[:, None], len(AIDS), axis=1) for v in (start.x, start.P, start.log_mu))),
            alternated=0,
            corrected=0,
            history=hindsight.start(runs),
        )

    def step(self, state: NavigatorState, readings: Readings, controls: Controls) -> tuple[NavigatorState, Output]:
        """One epoch."""
        settings: Settings = controls.settings
        rules = supervisor.Rules(settings.confirm, settings.within, 1, settings.hold_off)
        past = hindsight.keep(state.history, state.protected)
        imu_state, imu = self._imu.step(state.imu, readings, settings, rules)
        ins, flown = self._fly(state.ins, state.bias, imu)
        Phi, Q = self._model.matrices(flown)
        state, turning = self._turned(state, imu, flown)
        jump = None
        if imu.redundant is not None and imu.redundant.changed.any():
            jump = _bias_jump(imu.redundant)
            state = _widened(state, jump)
        kept = protected.begin(state.protected, turning, jump, settings)
        own = settings.propagator_models == "own"
        main, conventional, unprotected, alone = bank.predict(
            kept.main, state.conventional, state.unprotected, state.alone, Phi, Q, self._transition, own
        )
        kept = replace(kept, main=main)

        measured = self._measure(ins, readings, controls)
        m, m_u = measured[0], measured[-1]
        motion = Motion(_raw(state, m), state.reach, state.bias[:, 0])
        of_main, of_conventional = fault_tolerant.compare([main, conventional], m, settings)
        conventional, plain = fault_tolerant.examine(
            conventional, of_conventional, m, motion, settings, False, settings.recovery == "both"
        )
        conventional, plain_fusion = fault_tolerant.fuse(conventional, plain, plain.beta, settings)
        unprotected = imm.update(unprotected, m_u.y, m_u.H, m_u.R, m_u.valid)[0]
        alone = self._update_alone(alone, m)

        after, seen = protected.conclude(kept, of_main, m, motion, controls, Phi[:, 0], Q[:, 0])
        epoch = Epoch(
            controls,
            flown.protected(self._runs),
            jump,
            m.y,
            m.H,
            m.valid,
            motion,
            turning,
            kept.turned,
            seen.mu,
            seen.used,
            seen.decision.isolated,
        )
        past, after, seen, review = self._hindsight.review(past, epoch, after, seen)

        age, corrected = state.alternated + 1, state.corrected + 1
        turns, corrects = age >= settings.propagator_period, corrected >= settings.feedback_period
        if turns:
            after = protected.take_turns(after, seen.fused)
            conventional = fault_tolerant.alternate(conventional, plain_fusion.x, plain_fusion.P)
        past = hindsight.conclude(past, turns, seen.fused.x if corrects else None)
        new = NavigatorState(
            ins,
            state.bias * math.exp(-EPOCH / self._p.models.bias_time),
            state.learned,
            state.reach,
            state.usual,
            imu_state,
            after,
            conventional,
            unprotected,
            alone,
            0 if turns else age,
            corrected,
            past,
        )
        say = Ledger(self._layout, self._runs)
        estimates = (
            (seen.fused.x, seen.fused.P),
            (plain_fusion.x, plain_fusion.P),
            imm.combine(unprotected),
            imm.combine(alone),
        )
        self._report(say, new, estimates, seen, plain, imu)
        if corrects:
            new = self._correct(new, seen.fused.x)
        return new, output(say, _notices(seen, past, review, imu), left_out=imu.left_out)

    # ---- parts of an epoch ----------------------------------------------------------------------------------------

    def _fly(self, ins: InsState, bias: Array, imu: ImuEpoch) -> tuple[InsState, Flown]:
        """The strapdowns over one epoch."""
        runs, S, samples = imu.omega_b.shape[:3]
        omega_b = (imu.omega_b - bias[:, :, None, :3]).reshape(runs * S, samples, 3)
        f_b = (imu.f_b - bias[:, :, None, 3:]).reshape(runs * S, samples, 3)
        ins, interval = propagate(ins, omega_b, f_b, EPOCH / samples)
        return ins, Flown(interval.lla, interval.v_n, interval.f_n, interval.C_nb, imu.noise)

    def _turned(self, state: NavigatorState, imu: ImuEpoch, flown: Flown) -> tuple[NavigatorState, Array]:
        """What the epoch adds to the difference between the strapdown and the raw motion and to its reach, and to
        :attr:`Protected.turned`."""
        C_nb = flown.C_nb.reshape(self._runs, -1, 3, 3)[:, 0] * EPOCH
        omega_b = imu.omega_b[:, 0].mean(axis=1)
        step = np.concatenate([C_nb @ self._gyro_bias, C_nb * (self._scale_factor * omega_b)[:, None]], axis=-1)
        learned = state.learned + np.matvec(C_nb, state.bias[:, 0, :3])
        at_usual = C_nb * (self._scale_factor * state.usual)[:, None]
        after = replace(
            state,
            learned=learned,
            reach=state.reach + step,
            usual=state.usual + (omega_b - state.usual) * (EPOCH / LEARNING),
        )
        return after, np.concatenate([step[..., 3:], at_usual], axis=-1)

    def _measure(self, ins: InsState, readings: Readings, controls: Controls) -> list[Measured]:
        """All aids against each strapdown."""
        runs, S = self._runs, self._imu.solutions
        values, valid = np.empty((runs, len(AIDS), 3)), np.empty((runs, len(AIDS), 3), bool)
        for i, (name, quantity) in enumerate(READINGS.items()):
            group = readings[quantity]
            values[:, i] = group.values
            valid[:, i] = group.valid & controls.enabled[name]
        values = np.where(np.isnan(values), 0.0, values)
        y, H = measurements.aids(ins, self._chart, np.repeat(values, S, axis=0))
        y, H = y.reshape(runs, S, 9), H.reshape(runs, S, 9, N)
        return [Measured(y[:, i], H[:, i], self._R, valid.reshape(runs, 9)) for i in range(S)]

    def _update_alone(self, alone: Mixture, m: Measured) -> Mixture:
        rows = (self._runs, len(AIDS), 3)
        y, H, valid = m.y.reshape(rows), m.H.reshape(*rows, N), m.valid.reshape(rows)
        return imm.update(alone, y, H, self._R.reshape(1, *rows[1:]), valid)[0]

    def _correct(self, state: NavigatorState, dx: Array) -> NavigatorState:
        """Feedback of period T_4: the strapdown loses its estimated errors, and every filter counts from there."""
        runs, S = self._runs, self._imu.solutions
        unprotected = imm.combine(state.unprotected)[0] if S == 2 else dx
        both = np.stack([dx, unprotected][:S], axis=1)
        ins = ins_error.correct(state.ins, both.reshape(runs * S, N))
        return replace(
            state,
            ins=ins,
            bias=state.bias + both[..., BIASES],
            learned=state.learned + dx[:, ins_error.ATTITUDE],
            protected=protected.feed_back(state.protected, dx),
            conventional=fault_tolerant.feed_back(state.conventional, dx),
            unprotected=imm.shift(state.unprotected, unprotected),
            alone=imm.shift(state.alone, dx[:, None]),
            corrected=0,
        )

    def _report(
        self,
        say: Ledger,
        state: NavigatorState,
        estimates: Sequence[tuple[Array, Array]],
        seen: Outcome,
        plain: Examined,
        imu: ImuEpoch,
    ) -> None:
        """What the epoch came to; ``estimates`` in the order of :data:`.estimators.ESTIMATORS`, the last one of the
        three alone."""
        runs, S = self._runs, self._imu.solutions
        examined, main = seen.examined, state.protected.main
        assert examined.state is not None  # the main filter has both forms
        aid_tests.report(say, examined.innovation, examined.state, plain.innovation, examined.driving)
        aids.report(say, seen.decision.health, seen.used)
        weights.report(say, seen.alpha, seen.beta, main.mixture.mu, main.pair.reference, main.age)
        if imu.redundant is not None:
            r = imu.redundant
            instruments.report(say, r.sight, r.found, r.parity)
            say.judge("imu.{cluster}.{instrument}", r.decision.health.reshape(r.used.shape), r.used)
        used = np.zeros((1, len(CLUSTERS), 3), bool) if imu.redundant is None else imu.redundant.used
        say["used.imu.{cluster}.{instrument}"] = used
        ins = InsState(*(v.reshape(runs, S, *v.shape[1:]) for v in (state.ins.lla, state.ins.v_n, state.ins.C_nb)))
        *single, (x_alone, P_alone) = estimates
        x = np.concatenate([*(x[:, None] for x, _ in single), x_alone], axis=1)
        P = np.concatenate([*(P[:, None] for _, P in single), P_alone], axis=1)
        # The unprotected filter has a strapdown of its own, where there are two.
        corrects = [S - 1 if name == "unprotected" else 0 for name in ESTIMATORS]
        navigation.report(say, ins, corrects, x[..., :9], kalman.sound(P[..., :9, :9]))


def _raw(state: NavigatorState, m: Measured) -> Array:
    """The raw inertial attitude against the star tracker, ``(runs, 3)``; see :class:`Motion`."""
    rows = fault_tolerant.LAYOUT.slices[STARS]
    turn = np.linalg.solve(m.H[:, rows, ins_error.ATTITUDE], m.y[:, rows, None])[..., 0]
    seen = m.valid[:, rows].all(axis=-1, keepdims=True)
    return np.where(seen, turn + state.learned, np.nan)


def _bias_jump(imu: RedundantEpoch) -> Array:
    """Covariance ``(runs, 15, 15)`` of the jump of the body biases where the set of instruments changed."""
    jump = np.zeros((len(imu.changed), N, N))
    jump[:, ins_error.GYRO, ins_error.GYRO] = imu.bias_change[:, 0]
    jump[:, ins_error.ACCELEROMETER, ins_error.ACCELEROMETER] = imu.bias_change[:, 1]
    return jump


def _widened(state: NavigatorState, jump: Array) -> NavigatorState:
    """Tell the other filters on the protected strapdown of a jump of its errors, the propagators too."""
    return replace(
        state,
        conventional=fault_tolerant.widen(state.conventional, jump),
        alone=replace(state.alone, P=state.alone.P + jump[:, None, None]),
    )


def _notices(seen: Outcome, past: History, review: Review | None, imu: ImuEpoch) -> list[Notice]:
    notices = []
    rescued = seen.examined.rescued
    if rescued.any():
        notices.append(Notice("filter.reset", "propagators", rescued, {}))
    if review is not None:
        for i, aid in enumerate(AIDS):
            notices += flown_again({aid: review.named[:, i]}, review.since[:, i], past.past.now, EPOCH)
    if imu.redundant is not None and imu.redundant.changed.any():
        numbers = {
            f"{name}s_used": imu.redundant.used[:, c].sum(axis=-1).astype(float) for c, name in enumerate(CLUSTERS)
        }
        notices.append(Notice("imu.reconfigured", "imu", imu.redundant.changed, numbers))
    return notices
