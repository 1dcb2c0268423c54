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
from ftcore.estimation import imm, ins_error
from ftcore.estimation.federated import Estimate
from ftcore.estimation.imm import Mixture
from ftcore.estimation.strapdown import InsState, Interval, propagate
from ftcore.readings import Readings
from ftcore.systems.base import Controls, Flags, Notice, Output
from ftcore.systems.sins_gps_bd2_cns import bank, exclusion, measurements
from ftcore.systems.sins_gps_bd2_cns import branch as fault_tolerant
from ftcore.systems.sins_gps_bd2_cns import federation as federated_master
from ftcore.systems.sins_gps_bd2_cns.branch import STARS, Branch, Examined, Measured, Motion
from ftcore.systems.sins_gps_bd2_cns.federation import FederationState
from ftcore.systems.sins_gps_bd2_cns.forms import Parameters, Settings
from ftcore.systems.sins_gps_bd2_cns.imu import Epoch as ImuEpoch
from ftcore.systems.sins_gps_bd2_cns.imu import Imu
from ftcore.systems.sins_gps_bd2_cns.imu import State as ImuState
from ftcore.systems.sins_gps_bd2_cns.names import AID_READINGS, AIDS, CLUSTERS, EPOCH
from ftcore.systems.sins_gps_bd2_cns.reporter import Detail
from ftcore.systems.sins_gps_doppler.imu import ImuEpoch as RedundantEpoch

Array = NDArray[np.float64]
N = ins_error.CORE_STATES
BIASES = slice(9, 15)
DECAYING = np.arange(9, 15)
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
        turned: what scale factors of 1-sigma have turned the attitude by, as far as star fixes have not taken it away
            ``(runs, 3, 6)`` [rad]: at the rates flown, and through the drift that was learned at the usual ones.
        main, conventional: fault-tolerant filters with IMM and without.
        unprotected: IMM of all aids without any test, ``(runs, 2, ...)``.
        alone: IMMs of one aid each, ``(runs, 3, 2, ...)``.
        federation: the federated master, where it is chosen.
        alternated, corrected: epochs since the propagators took turns, since the strapdown was corrected.
    """

    ins: InsState
    bias: Array
    learned: Array
    reach: Array
    usual: Array
    turned: Array
    imu: ImuState
    main: Branch
    conventional: Branch
    unprotected: Mixture
    alone: Mixture
    supervisor: supervisor.State
    federation: FederationState | None
    alternated: int
    corrected: int


class Navigator:
    """See :class:`ftcore.systems.base.Navigator`."""

    def __init__(
        self, p: Parameters, chart: measurements.Chart, runs: int, alignment: InsState, calibration: Array
    ) -> None:
        self._p = p
        self._chart = chart
        self._runs = runs
        self._alignment = alignment
        self._imu = Imu(p, runs, calibration)
        m = p.models
        self._mu = np.array([1.0 - m.start_large, m.start_large])
        self._transition = imm.transition_matrix([[m.stay, 1.0 - m.stay], [1.0 - m.stay, m.stay]])
        self._scale = np.array([1.0, m.ratio])
        cns = units.to_si(p.aiding.cns, "arcsec")
        self._R = np.square(np.array([*p.aiding.gps, *p.aiding.bd2, cns, cns, cns]))
        self._P0 = self._initial_covariance()
        self._gyro_bias = np.linalg.cholesky(self._imu.bias_covariance()[0])
        self._scale_factor = units.to_si(p.inertial.scale_factor, "ppm")
        # The axes of the plain IMU are alike: its noise looks the same from any frame.
        self._plain_density = self._spectrum(self._imu.noise[0])

    def initial(self, controls: Controls) -> NavigatorState:
        """Before the first epoch: aligned, everybody trusted."""
        runs, S = self._runs, self._imu.solutions
        a = self._alignment
        x = np.zeros((runs, N))
        P = np.broadcast_to(self._P0, (runs, N, N))
        start = imm.start(x, P, self._mu)
        return NavigatorState(
            ins=InsState(*(np.repeat(v, S, axis=0) for v in (a.lla, a.v_n, a.C_nb))),
            bias=np.zeros((runs, S, 6)),
            learned=np.zeros((runs, 3)),
            reach=np.zeros((runs, 3, 6)),
            usual=np.zeros((runs, 3)),
            turned=np.zeros((runs, 3, 6)),
            imu=self._imu.initial(),
            main=fault_tolerant.start(x, P, self._mu),
            conventional=fault_tolerant.start(x, P, np.ones(1)),
            unprotected=start,
            alone=Mixture(*(np.repeat(v[:, None], len(AIDS), axis=1) for v in (start.x, start.P, start.log_mu))),
            supervisor=supervisor.start(runs, len(AIDS)),
            federation=None,
            alternated=0,
            corrected=0,
        )

    def step(self, state: NavigatorState, readings: Readings, controls: Controls) -> tuple[NavigatorState, Output]:
        """One epoch."""
        settings: Settings = controls.settings
        rules = supervisor.Rules(settings.confirm, settings.within, 1, settings.hold_off)
        imu_state, imu = self._imu.step(state.imu, readings, settings, rules)
        ins, interval, Phi, Q = self._fly(state.ins, state.bias, imu)
        state = self._turned(state, imu, interval)
        state = _master_changed(state, settings)
        if imu.redundant is not None and imu.redundant.changed.any():
            state = _widened(state, _bias_jump(imu.redundant))
        own = settings.propagator_models == "own"
        main, conventional, unprotected, alone = bank.predict(
            state.main, state.conventional, state.unprotected, state.alone, Phi, Q, self._transition, own
        )
        probabilities = main.mixture.mu

        measured = self._measure(ins, readings, controls)
        m, m_u = measured[0], measured[-1]
        motion = Motion(_raw(state, m), state.reach, state.bias[:, 0])
        of_main, of_conventional = fault_tolerant.compare([main, conventional], m, settings)
        main, examined = fault_tolerant.examine(main, of_main, m, motion, settings, True, settings.recovery != "none")
        conventional, plain = fault_tolerant.examine(
            conventional, of_conventional, m, motion, settings, False, settings.recovery == "both"
        )
        conventional, plain_fusion = fault_tolerant.fuse(conventional, plain, plain.beta, settings)
        unprotected = imm.update(unprotected, m_u.y, m_u.H, m_u.R, m_u.valid)[0]
        alone = self._update_alone(alone, m)

        supervision, decision = exclusion.decide(state.supervisor, examined, m, state.turned, controls, rules)
        federation = state.federation
        if federation is not None:
            used = decision.use & examined.driving.present
            main, fusion = fault_tolerant.fuse(main, examined, used.astype(float), settings)
            noise = (probabilities[:, :, None, None] * Q[:, 0]).sum(axis=1)
            federation = federated_master.step(federation, Phi[:, 0], noise, m, decision, settings)
            fused = federation.fused
        else:
            beta = examined.beta
            if settings.exclusion == "isolation":
                beta = np.where(decision.isolated & ~examined.believed, 0.0, beta)
            main, fusion = fault_tolerant.fuse(main, examined, beta, settings)
            used = (beta > 0.0) & examined.driving.present
            fused = Estimate(fusion.x, fusion.P)
        forgotten = exclusion.forgets(decision, settings)
        if forgotten.any():
            main = fault_tolerant.go_back(main, forgotten)
            known = Estimate(*main.pair.estimate())
            if federation is not None:
                federation = federated_master.restart(federation, known, forgotten)
            fused = Estimate(
                np.where(forgotten[:, None], known.x, fused.x), np.where(forgotten[:, None, None], known.P, fused.P)
            )

        age, corrected = state.alternated + 1, state.corrected + 1
        if age >= settings.propagator_period:
            main = fault_tolerant.alternate(main, fused.x, fused.P)
            conventional = fault_tolerant.alternate(conventional, plain_fusion.x, plain_fusion.P)
            age = 0
        after = NavigatorState(
            ins,
            state.bias * math.exp(-EPOCH / self._p.models.bias_time),
            state.learned,
            state.reach,
            state.usual,
            exclusion.kept(state.turned, examined, m),
            imu_state,
            main,
            conventional,
            unprotected,
            alone,
            supervision,
            federation,
            age,
            corrected,
        )
        estimates = (
            (fused.x, fused.P),
            (plain_fusion.x, plain_fusion.P),
            imm.combine(unprotected),
            imm.combine(alone),
        )
        detail = self._detail(after, estimates, fusion.alpha, examined, imu)
        if corrected >= settings.feedback_period:
            after = self._correct(after, fused.x)
        return after, self._output(examined, plain, imu, decision, used, forgotten, detail)

    # ---- parts of an epoch ----------------------------------------------------------------------------------------

    def _fly(self, ins: InsState, bias: Array, imu: ImuEpoch) -> tuple[InsState, Interval, Array, Array]:
        """The strapdowns over one epoch; Phi ``(runs, S, 15, 15)``, Q ``(runs, S, 2, 15, 15)`` of both models."""
        runs, S, samples = imu.omega_b.shape[:3]
        m = self._p.models
        omega_b = (imu.omega_b - bias[:, :, None, :3]).reshape(runs * S, samples, 3)
        f_b = (imu.f_b - bias[:, :, None, 3:]).reshape(runs * S, samples, 3)
        ins, interval = propagate(ins, omega_b, f_b, EPOCH / samples)
        F = ins_error.core_matrix(interval.lla, interval.v_n, interval.f_n, interval.C_nb)
        F[:, DECAYING, DECAYING] = -1.0 / m.bias_time
        Phi = ins_error.transition(F, EPOCH)
        Q = ins_error.process_noise(F, self._density(interval, imu.noise), EPOCH)
        shape = (runs, S, N, N)
        return ins, interval, Phi.reshape(shape), Q.reshape(shape)[:, :, None] * self._scale[:, None, None]

    def _turned(self, state: NavigatorState, imu: ImuEpoch, interval: Interval) -> NavigatorState:
        """What the epoch adds to the difference between the strapdown and the raw motion, and to its reach."""
        C_nb = interval.C_nb.reshape(self._runs, -1, 3, 3)[:, 0] * EPOCH
        omega_b = imu.omega_b[:, 0].mean(axis=1)
        step = np.concatenate([C_nb @ self._gyro_bias, C_nb * (self._scale_factor * omega_b)[:, None]], axis=-1)
        learned = state.learned + np.matvec(C_nb, state.bias[:, 0, :3])
        at_usual = C_nb * (self._scale_factor * state.usual)[:, None]
        return replace(
            state,
            learned=learned,
            reach=state.reach + step,
            usual=state.usual + (omega_b - state.usual) * (EPOCH / LEARNING),
            turned=state.turned + np.concatenate([step[..., 3:], at_usual], axis=-1),
        )

    def _density(self, interval: Interval, body: Array) -> Array:
        """Spectral density ``(runs S or 1, 15, 15)`` of Q_small: white noise of the IMU, and what drives its biases."""
        if self._imu.solutions == 1:
            return self._plain_density
        C = interval.C_nb[:, None]
        return self._spectrum(C @ body.reshape(-1, 2, 3, 3) @ C.swapaxes(-1, -2))

    def _spectrum(self, level: Array) -> Array:
        """The same from the white noise of gyros and accelerometers in the level frame, ``(..., 2, 3, 3)``."""
        m = self._p.models
        Qc = np.zeros((*level.shape[:-3], N, N))
        Qc[..., ins_error.ATTITUDE, ins_error.ATTITUDE] = m.noise_scale * level[..., 0, :, :]
        Qc[..., ins_error.VELOCITY, ins_error.VELOCITY] = m.noise_scale * level[..., 1, :, :]
        walk = m.noise_scale * m.bias_instability**2 * 2.0 / m.bias_time * self._imu.bias_covariance()
        Qc[..., ins_error.GYRO, ins_error.GYRO] = walk[0]
        Qc[..., ins_error.ACCELEROMETER, ins_error.ACCELEROMETER] = walk[1]
        return Qc

    def _measure(self, ins: InsState, readings: Readings, controls: Controls) -> list[Measured]:
        """All aids against each strapdown."""
        runs, S = self._runs, self._imu.solutions
        values, valid = np.empty((runs, len(AIDS), 3)), np.empty((runs, len(AIDS), 3), bool)
        for i, (name, quantity) in enumerate(AID_READINGS.items()):
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
            main=fault_tolerant.feed_back(state.main, dx),
            conventional=fault_tolerant.feed_back(state.conventional, dx),
            unprotected=imm.shift(state.unprotected, unprotected),
            alone=imm.shift(state.alone, dx[:, None]),
            federation=None if state.federation is None else federated_master.shift(state.federation, dx),
            corrected=0,
        )

    def _initial_covariance(self) -> Array:
        """P(0) ``(15, 15)``: alignment and repeatability of the sensors."""
        n = self._p.initial
        sigma = np.array([n.position] * 3 + [n.velocity] * 3 + [n.tilt, n.tilt, n.azimuth] + [0.0] * 6)
        # A state that is known exactly keeps a hair of variance, so that every covariance has an inverse.
        floor = np.array([1e-6] * 9 + [1e-12] * 3 + [1e-9] * 3)
        P0 = np.diag(np.maximum(sigma, floor) ** 2)
        body = self._imu.bias_covariance()
        P0[ins_error.GYRO, ins_error.GYRO] += body[0]
        start = units.to_si(self._p.models.accelerometer_start, "ug") / max(self._imu.bias[1], 1e-12)
        P0[ins_error.ACCELEROMETER, ins_error.ACCELEROMETER] += start**2 * body[1]
        return P0

    def _detail(
        self,
        state: NavigatorState,
        estimates: Sequence[tuple[Array, Array]],
        alpha: Array,
        examined: Examined,
        imu: ImuEpoch,
    ) -> Detail:
        """What the reporter shows; ``estimates`` in the order fused, without IMM, unprotected, the three alone."""
        runs, S = self._runs, self._imu.solutions
        ins = InsState(*(v.reshape(runs, S, *v.shape[1:]) for v in (state.ins.lla, state.ins.v_n, state.ins.C_nb)))
        *single, (x_alone, P_alone) = estimates
        x = np.concatenate([*(x[:, None] for x, _ in single), x_alone], axis=1)
        P = np.concatenate([*(P[:, None] for _, P in single), P_alone], axis=1)
        return Detail(
            ins=ins,
            x=x[..., :9],
            P=P[..., :9, :9],
            alpha=alpha,
            mu=state.main.mixture.mu,
            doubt=np.where(examined.driving.present, examined.innovation.suspect, np.nan),
            beta=examined.beta,
            reference=state.main.pair.reference,
            age=state.main.age,
            parity=None if imu.redundant is None else imu.redundant.parity,
        )

    def _output(
        self,
        examined: Examined,
        plain: Examined,
        imu: ImuEpoch,
        decision: supervisor.Decision,
        used: Flags,
        forgotten: Flags,
        detail: Detail,
    ) -> Output:
        assert examined.state is not None  # the main filter has both forms
        tests = (examined.innovation, examined.state, plain.innovation)
        absent = ~np.concatenate([t.present for t in tests], axis=-1)
        statistic = np.where(absent, np.nan, np.concatenate([t.q for t in tests], axis=-1))
        columns = (
            statistic,
            np.concatenate([t.reject for t in tests], axis=-1),
            np.concatenate([t.dof for t in tests], axis=-1).astype(float),
            np.concatenate([t.alarm for t in tests], axis=-1),
        )
        both = [np.concatenate([a, b], axis=-1) for a, b in zip(columns, imu.tests, strict=True)]
        return Output(
            statistic=both[0],
            threshold=both[1],
            dof=both[2],
            alarm=both[3],
            health=np.concatenate([decision.health, imu.health], axis=-1).astype(np.int8),
            used=np.concatenate([used, imu.used], axis=-1),
            notices=_notices(examined, forgotten, imu),
            detail=detail,
            left_out=imu.left_out,
        )


def _raw(state: NavigatorState, m: Measured) -> Array:
    """The raw inertial attitude against the star tracker, ``(runs, 3)``; see :class:`Motion`."""
    rows = fault_tolerant.LAYOUT.slices[STARS]
    turn = np.linalg.solve(m.H[:, rows, ins_error.ATTITUDE], m.y[:, rows, None])[..., 0]
    seen = m.valid[:, rows].all(axis=-1, keepdims=True)
    return np.where(seen, turn + state.learned, np.nan)


def _master_changed(state: NavigatorState, settings: Settings) -> NavigatorState:
    """Hand the estimate over where the operator has chosen another master."""
    if settings.master == "federated" and state.federation is None:
        known = Estimate(*imm.combine(state.main.mixture))
        return replace(state, federation=federated_master.start(known, settings))
    if settings.master != "federated" and state.federation is not None:
        known, mixture = state.federation.fused, state.main.mixture
        models = mixture.log_mu.shape[-1]
        x = np.repeat(known.x[:, None], models, axis=1)
        P = np.repeat(known.P[:, None], models, axis=1)
        main = replace(state.main, mixture=Mixture(x, P, mixture.log_mu))
        return replace(state, main=main, federation=None)
    return state


def _bias_jump(imu: RedundantEpoch) -> Array:
    """Covariance ``(runs, 15, 15)`` of the jump of the body biases where the set of instruments changed."""
    jump = np.zeros((len(imu.changed), N, N))
    jump[:, ins_error.GYRO, ins_error.GYRO] = imu.bias_change[:, 0]
    jump[:, ins_error.ACCELEROMETER, ins_error.ACCELEROMETER] = imu.bias_change[:, 1]
    return jump


def _widened(state: NavigatorState, jump: Array) -> NavigatorState:
    """Tell all filters on the protected strapdown of a jump of its errors, the propagators too."""
    federation = state.federation
    return replace(
        state,
        main=fault_tolerant.widen(state.main, jump),
        conventional=fault_tolerant.widen(state.conventional, jump),
        alone=replace(state.alone, P=state.alone.P + jump[:, None, None]),
        federation=None if federation is None else federated_master.widen(federation, jump),
    )


def _notices(examined: Examined, forgotten: Flags, imu: ImuEpoch) -> list[Notice]:
    notices = []
    for subject, where in (("propagators", examined.rescued), ("fusion", forgotten)):
        if where.any():
            notices.append(Notice("filter.reset", subject, where, {}))
    if imu.redundant is not None and imu.redundant.changed.any():
        numbers = {
            f"{name}s_used": imu.redundant.used[:, c].sum(axis=-1).astype(float) for c, name in enumerate(CLUSTERS)
        }
        notices.append(Notice("imu.reconfigured", "imu", imu.redundant.changed, numbers))
    return notices
