"""Estimation, detection and control of the three aircraft: sees readings only.

One epoch, in the order of the code: parity space tests the protected aircraft's gyros; where it declares more than one,
the UKF comes forward without them; the supervisor decides; rates are solved from the gyros that are used, or taken from
the UKF where these do not see all directions; attitudes are carried on; the control law commands the next epoch.

How many gyros are trusted decides what can be known:

    3   three parity equations: one fault is detected and, outside the singular directions, isolated
    2   one parity equation: a second fault is detected; the UKF isolates it, without the UKF nobody can
    1   no parity equation; two rates are measured, the third is the UKF's, without the UKF the last one is held
    0   the UKF's rates; without the UKF this is never chosen, only met when no gyro has a reading

Where nobody can be isolated it is said (`integrity.cannot-isolate`), nobody is put out, and the flight goes on with
the readings that fit together best: of all that read, for where two faults have met who was isolated before may well be
the sound one. Where two choices are alike, all are used: a fault then enters by half, while a wrong choice would let
all of it in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import chi_square, geometry, parity, supervisor
from ftcore.detection.geometry import Cluster
from ftcore.parts.ledger import Layout, Ledger
from ftcore.readings import Readings
from ftcore.rotation import matrix_to_rpy, rotvec_to_matrix, rpy_to_matrix
from ftcore.systems.base import Controls, Flags, Notice, Output
from ftcore.systems.redundant_imu import aircraft, analytic, decision, fdi
from ftcore.systems.redundant_imu.aircraft import AIRCRAFT, EPOCH, PROTECTED
from ftcore.systems.redundant_imu.analytic import AIR, AIR_DATA, CLEAR, AnalyticRedundancy, Episode, Moment
from ftcore.systems.redundant_imu.forms import Parameters, Settings
from ftcore.systems.redundant_imu.gyros import GYRO, INSTRUMENTS, SUBJECTS
from ftcore.systems.redundant_imu.model import ATTITUDE, RATES, FlightModel
from ftcore.systems.reporting import output
from ftcore.systems.two_axis import unpaired

Array = NDArray[np.float64]
AXES = 2 * INSTRUMENTS


@dataclass(frozen=True)
class NavigatorState:
    """Everything the navigators carry from epoch to epoch; ``(runs, aircraft, ...)`` where not said otherwise.

    Attributes:
        C_nb, rates: attitude and the rates last handed to the control law.
        air: last valid air data: airspeed, angles of attack and sideslip, height.
        power, u: engine power and controls, as far as the model of the UKF has them.
        supervisor: of the three gyros.
        episode: analytic redundancy.
        undecided: ``(runs,)`` epochs in a row in which it could not be told who of the suspects it is.
        told: ``(runs,)`` that it cannot be told has been said, and still holds.
        clear: ``(runs,)`` epochs in a row in which there was nothing that could not be told.
    """

    epoch: int
    C_nb: Array
    rates: Array
    air: Array
    power: Array
    u: Array
    supervisor: supervisor.State
    episode: Episode
    undecided: NDArray[np.int64]
    told: Flags
    clear: NDArray[np.int64]


class Navigator:
    """See :class:`ftcore.systems.base.Navigator`.

    Args:
        p: parameters.
        cluster: geometry of the gyros.
        model: what the UKF believes of the aircraft.
        law: commands ``(runs, aircraft, 4)`` at an epoch, for measured states ``(runs, aircraft, 10)``.
        alignment: states ``(runs, aircraft, 13)`` and controls ``(runs, aircraft, 4)`` at the start.
        layout: of the ledger.
    """

    def __init__(
        self,
        p: Parameters,
        cluster: Cluster,
        model: FlightModel,
        law: Callable[[int, Array], Array],
        alignment: tuple[Array, Array],
        layout: Layout,
    ) -> None:
        self._layout = layout
        self._cluster, self._model, self._law = cluster, model, law
        self._x0, self._u0 = alignment
        self._runs = len(self._x0)
        self._noise = p.gyros.noise
        self._expected = fdi.reference(cluster, p.gyros.noise)
        self._analytic = AnalyticRedundancy(model, cluster.H, p)

    def initial(self, controls: Controls) -> NavigatorState:
        """Before the first epoch: aligned, everybody trusted."""
        x, u = self._x0, self._u0
        air, power = x[..., [0, 1, 2, 11]], x[..., 12]
        start = Moment(
            x=_modelled(air, x[..., 3:5], x[..., 6:9])[:, PROTECTED],
            power=power[:, PROTECTED],
            u=u[:, PROTECTED],
            y=np.zeros((self._runs, AXES + len(AIR_DATA))),
            valid=np.zeros((self._runs, AXES + len(AIR_DATA)), bool),
        )
        return NavigatorState(
            epoch=0,
            C_nb=rpy_to_matrix(x[..., 3:6]),
            rates=x[..., 6:9],
            air=air,
            power=power,
            u=u,
            supervisor=supervisor.start(self._runs, INSTRUMENTS),
            episode=self._analytic.initial(start),
            undecided=np.zeros(self._runs, np.int64),
            told=np.zeros(self._runs, bool),
            clear=np.zeros(self._runs, np.int64),
        )

    def step(self, state: NavigatorState, readings: Readings, controls: Controls) -> tuple[NavigatorState, Output]:
        """One epoch."""
        settings: Settings = controls.settings
        m, present = self._gyros(readings)
        fresh, air_valid = self._air(readings, controls)
        air = np.where(air_valid, fresh, state.air)
        surfaces = readings.aiding.get("surfaces")
        state = state if surfaces is None else self._as_set(state, surfaces)
        power = self._model.spool(state.power, state.u)
        mine, there = m[:, PROTECTED], present[:, PROTECTED]
        y = np.concatenate([mine, air[:, PROTECTED]], axis=-1)
        valid = np.concatenate([np.repeat(there, 2, axis=-1), air_valid[:, PROTECTED]], axis=-1)

        # Parity space.
        enabled = np.array([[controls.enabled[s] for s in SUBJECTS]])
        inside = there & enabled & (state.supervisor.health < supervisor.ISOLATED)
        verdict = fdi.judge(self._expected, mine, there & enabled, inside, settings)
        several = verdict.declared.sum(axis=-1) > 1

        # Analytic redundancy: a new doubt starts the UKF anew, from before the fault; so does having too few gyros.
        episode = state.episode
        blind = ~self._cluster.observable[geometry.mask_index(inside)]
        unheard = (verdict.declared & ~episode.suspects).any(axis=-1)
        doubt = several & (~episode.open | unheard) & settings.hybrid
        begin = doubt | blind & ~episode.active & settings.hybrid
        accused = verdict.declared & doubt[:, None] | episode.suspects & episode.open[:, None]
        moment = Moment(state.episode.past[-1].x, power[:, PROTECTED], state.u[:, PROTECTED], y, valid)
        episode = self._analytic.advance(episode, moment, begin, accused, ~inside, settings.lead)
        ukf = self._analytic.test(episode, mine, episode.suspects | ~inside, there & enabled, settings)
        guilty = ukf.alarm & episode.suspects
        # Who is named must stand out: a filter that a drift has reached blames all suspects alike.
        least = np.where(guilty, ukf.statistic, np.inf).min(axis=-1)
        most = np.where(episode.suspects & ~guilty, ukf.statistic, -np.inf).max(axis=-1)
        margin = chi_square.threshold(settings.false_alarm_probability, 1)
        clueless = ~np.isfinite(least) | ~np.isfinite(most) | (least - most < margin)
        # Of several that only parity space declares nobody can be named.
        helpless = several & ~episode.open
        unknown = helpless | episode.open & verdict.detected & clueless
        undecided, clear = np.where(unknown, state.undecided + 1, 0), np.where(unknown, 0, state.clear + 1)

        # Decision.
        # While nobody can be told apart, noise makes one the only declared now and then: that is no verdict.
        alone = verdict.declared & ~(helpless | state.told)[:, None]
        accusation = np.where(episode.open[:, None], guilty & ~clueless[:, None], alone)
        accusation &= verdict.detected[:, None] & inside
        trusted = inside & ~(episode.suspects & episode.open[:, None]) & ~accusation
        supervision, decided = supervisor.step(
            state.supervisor,
            accusation,
            self._admission(episode, mine, trusted, verdict, settings) & there,
            np.broadcast_to(enabled, inside.shape),
            supervisor.Rules(settings.confirm, settings.within, 1, settings.hold_off, isolate_last=False),
        )
        isolated = decided.health == supervisor.ISOLATED
        withheld = episode.suspects & (episode.open & ~(episode.suspects & isolated).any(axis=-1))[:, None]
        unnamed = (helpless | state.told & ~episode.open & verdict.detected)[:, None]
        doubted = withheld | verdict.declared & unnamed
        health = np.where(doubted & (decided.health == supervisor.HEALTHY), supervisor.SUSPECT, decided.health)
        fitting = there & enabled & ~np.where(helpless[:, None], verdict.spare, verdict.declared)
        used = np.where(unnamed & there.all(axis=-1, keepdims=True), fitting, decided.use & there & ~withheld)
        solvable = self._cluster.observable[geometry.mask_index(used)]

        # Rates, attitude, control.
        from_model = episode.active & ~solvable
        everything = present.copy()
        everything[:, : AIRCRAFT - 1] &= enabled[:, None]
        used = np.where((solvable | from_model)[:, None], used, everything[:, PROTECTED])
        everything[:, PROTECTED] = np.where(from_model[:, None], everything[:, PROTECTED], used)
        rates = geometry.solve(self._cluster, m.reshape(-1, AXES), everything.reshape(-1, INSTRUMENTS))
        rates = rates.reshape(self._runs, AIRCRAFT, 3)
        rates[:, PROTECTED] += self._unseen(used, state.rates[:, PROTECTED])
        rates[:, PROTECTED] = np.where(from_model[:, None], episode.x[:, RATES], rates[:, PROTECTED])
        C_nb = state.C_nb @ rotvec_to_matrix((0.5 * EPOCH) * (state.rates + rates))
        rpy = matrix_to_rpy(C_nb)
        if from_model.any():
            # Air data hold the filter's roll and pitch; what is integrated from its rates alone would drift.
            rpy[:, PROTECTED, :2] = np.where(from_model[:, None], episode.x[:, ATTITUDE], rpy[:, PROTECTED, :2])
            C_nb[:, PROTECTED] = np.where(
                from_model[:, None, None], rpy_to_matrix(rpy[:, PROTECTED]), C_nb[:, PROTECTED]
            )
        x = _modelled(air, rpy[..., :2], rates)
        epoch = state.epoch + 1
        command = self._law(epoch, np.concatenate([x, power[..., None]], axis=-1))
        u = command if surfaces is None else np.concatenate([command[..., :1], surfaces], axis=-1)

        moment = replace(moment, x=x[:, PROTECTED], u=u[:, PROTECTED])
        remembered = self._analytic.settle(episode, verdict.detected, isolated, blind, moment)
        told = (state.told | (undecided >= settings.within)) & (clear < CLEAR) & ~decided.just_isolated.any(axis=-1)
        after = NavigatorState(epoch, C_nb, rates, air, power, u, supervision, remembered, undecided, told, clear)
        say = Ledger(self._layout, self._runs)
        fdi.report(say, verdict)
        analytic.report(say, episode, ukf)
        decision.report(say, health, used, doubted, told, from_model)
        aircraft.report(say, rates, u)
        over = episode.active & ~remembered.active
        events = _notices(begin, over, state.told, told, doubted, verdict, episode, settings)
        return after, output(say, events, command, unpaired(readings, (GYRO,)))

    # ---- parts of an epoch ----------------------------------------------------------------------------------------

    def _gyros(self, readings: Readings) -> tuple[Array, Flags]:
        """Readings ``(runs, aircraft, 6)``, 0 where there is none; which instruments read ``(runs, aircraft, 3)``."""
        group, shape = readings[GYRO], (self._runs, AIRCRAFT, AXES)
        valid = np.broadcast_to(group.valid, group.values.shape).reshape(shape)
        present: Flags = np.asarray(valid.reshape(self._runs, AIRCRAFT, INSTRUMENTS, 2).all(axis=-1))
        return np.where(valid, group.values.reshape(shape), 0.0), present

    def _as_set(self, state: NavigatorState, surfaces: Array) -> NavigatorState:
        """The state before this epoch, with surfaces as another's control laws set them ``(runs, aircraft, 3)``."""
        u = np.concatenate([state.u[..., :1], surfaces], axis=-1)
        *past, last = state.episode.past
        return replace(state, u=u, episode=replace(state.episode, past=(*past, replace(last, u=u[:, PROTECTED]))))

    def _air(self, readings: Readings, controls: Controls) -> tuple[Array, Flags]:
        """Air data ``(runs, aircraft, 4)`` and where there is a reading."""
        groups = [readings[f"{AIR}.{name}"] for name in AIR_DATA]
        values = np.stack([g.values for g in groups], axis=-1)
        valid = np.empty(values.shape, bool)
        for i, g in enumerate(groups):
            valid[..., i] = g.valid
        switched = np.ones((AIRCRAFT, 1), bool)
        switched[: AIRCRAFT - 1] = controls.enabled[AIR]
        return values, np.asarray(valid & switched & np.isfinite(values))

    def _unseen(self, used: Flags, before: Array) -> Array:
        """The part of the rates ``before (runs, 3)`` that the gyros used do not see: held, for want of better."""
        index = geometry.mask_index(used)
        blind = ~self._cluster.observable[index]
        if not blind.any():
            return np.zeros_like(before)
        seen = self._cluster.gains[index] @ self._cluster.H
        return np.where(blind[:, None], before - np.matvec(seen, before), 0.0)

    def _admission(self, episode: Episode, m: Array, trusted: Flags, verdict: fdi.Verdict, settings: Settings) -> Flags:
        """Whether a gyro that is out agrees with what is left, ``(runs, 3)``.

        That is: with the rates of two trusted ones that agree with each other, or of the UKF where these are fewer; or,
        whatever the UKF holds, when all three agree, or would without a trusted one (:func:`parity.admission`).
        """
        if trusted.all():
            return trusted
        # A long hold-off shall not keep out who is sound: it passes all of it with a probability of 90 % at least.
        p_fa = min(settings.false_alarm_probability, 0.1 / settings.hold_off)
        index = geometry.mask_index(trusted)
        solvable = self._cluster.observable[index]
        rates = geometry.solve(self._cluster, m, trusted)
        C = self._noise**2 * self._cluster.covariances[index]
        model = (episode.active & ~solvable)[:, None]
        rates = np.where(model, episode.x[:, RATES], rates)
        C = np.where(model[..., None], episode.P[:, RATES, RATES], C)
        H = self._cluster.H.reshape(INSTRUMENTS, 2, 3)
        r = m.reshape(-1, INSTRUMENTS, 2) - np.matvec(H, rates[:, None])
        S = H @ C[:, None] @ H.swapaxes(-1, -2) + self._noise**2 * np.eye(2)
        statistic = np.vecdot(r, np.matvec(np.linalg.inv(S), r))
        passed = (statistic <= chi_square.threshold(p_fa, 2)) & (solvable & ~verdict.detected | model[:, 0])[:, None]
        among = parity.admission(verdict.whole, trusted, verdict.detected, p_fa)
        # Of two that read, parity space sees one direction in four: the UKF, where it runs, knows better.
        enough = verdict.whole.used.all(axis=-1) | ~episode.active
        return np.asarray(passed | among & enough[:, None])


def _modelled(air: Array, roll_pitch: Array, rates: Array) -> Array:
    """The nine modelled states out of air data, attitude and rates."""
    return np.concatenate([air[..., :3], roll_pitch, rates, air[..., 3:]], axis=-1)


def _notices(
    begin: Flags,
    over: Flags,
    was_told: Flags,
    told: Flags,
    doubted: Flags,
    verdict: fdi.Verdict,
    episode: Episode,
    settings: Settings,
) -> list[Notice]:
    notices = []
    if begin.any():
        numbers = {
            "suspects": episode.suspects.sum(axis=-1).astype(np.float64),
            "lead": np.full(len(begin), float(settings.lead)),
        }
        notices.append(Notice("filter.started", "ukf", begin, numbers))
    rest = verdict.rest
    numbers = {"statistic": rest.FD, "threshold": rest.threshold, "dof": np.asarray(rest.dof, np.float64)}
    if (told & ~was_told).any():
        suspects = {"suspects": doubted.sum(axis=-1).astype(np.float64)}
        notices.append(Notice("integrity.cannot-isolate", GYRO, told & ~was_told, numbers | suspects))
    if (was_told & ~told).any():
        notices.append(Notice("integrity.restored", GYRO, was_told & ~told, numbers))
    if over.any():
        notices.append(Notice("filter.stopped", "ukf", over, {}))
    return notices
