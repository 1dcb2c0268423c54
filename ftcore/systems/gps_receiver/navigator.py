"""Estimation and detection of the GPS receiver: sees readings only.

One epoch, in the order of the code: the snapshot is solved, tested and relieved of its culprits; the three filters are
carried over and their innovations tested; the two tests are combined and the supervisor decides; each filter takes what
its own test leaves; the combined filter that disagrees with its own satellites for too long restarts from them; last,
how large an error could hide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore import earth
from ftcore.detection import chi_square, raim, supervisor
from ftcore.detection.raim import CANNOT_DETECT, CANNOT_ISOLATE, CONSISTENT, EXCLUDED, NO_FIX, Consistency, Isolation
from ftcore.estimation import kalman, least_squares
from ftcore.estimation.least_squares import Fix
from ftcore.readings import Readings
from ftcore.systems.base import Controls, Flags, LeftOut, Notice, Output
from ftcore.systems.gps_receiver import bank as filters
from ftcore.systems.gps_receiver import snapshot as snapshots
from ftcore.systems.gps_receiver.bank import COMBINED, FILTER, PLACE, UNPROTECTED, Bank
from ftcore.systems.gps_receiver.forms import Parameters, Settings
from ftcore.systems.gps_receiver.integrity import protect
from ftcore.systems.gps_receiver.measurements import Measurement, pseudoranges
from ftcore.systems.gps_receiver.names import SATELLITES
from ftcore.systems.gps_receiver.reporter import Detail
from ftcore.systems.gps_receiver.snapshot import Judgement, Place, Snapshot

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

SURVIVORS, EVERYONE = 0, 3
"""Which of the four sets holds the snapshot's satellites, and which every one."""
REDUNDANT = 5
"""Satellites that an innovation test leaves at least, if there are more: with fewer the rest does not check itself."""


@dataclass(frozen=True)
class NavigatorState:
    """Everything the navigator carries from epoch to epoch.

    ``disagreed`` (runs,): epochs in a row that the combined filter has disagreed with its own satellites; ``waited``
    (runs, 2): epochs in a row that filter and combined filter have taken nothing, not knowing what is wrong; ``status``
    (runs,): of the combined solution.
    """

    place: Place
    bank: Bank
    supervisor: supervisor.State
    disagreed: NDArray[np.int64]
    waited: NDArray[np.int64]
    status: Codes


@dataclass(frozen=True)
class Agreement:
    """The combined filter's prediction against a snapshot of the satellites it takes, all (runs,)."""

    statistic: Array
    dof: NDArray[np.int64]
    limit: Array
    alarm: Flags


class Navigator:
    """See :class:`ftcore.systems.base.Navigator`."""

    def __init__(self, p: Parameters, runs: int, dt: float) -> None:
        self._p = p
        self._runs = runs
        self._Phi, self._Q = filters.transition(p.filter, dt)

    def initial(self, controls: Controls) -> NavigatorState:
        """Before the first epoch: nothing is known."""
        runs = self._runs
        return NavigatorState(
            snapshots.nowhere(runs),
            filters.empty(runs),
            supervisor.start(runs, len(SATELLITES)),
            np.zeros(runs, np.int64),
            np.zeros((runs, 2), np.int64),
            np.full(runs, CONSISTENT, np.int8),
        )

    def step(self, state: NavigatorState, readings: Readings, controls: Controls) -> tuple[NavigatorState, Output]:
        """One epoch."""
        settings: Settings = controls.settings
        p_fa = settings.false_alarm_probability
        margin = raim.margin(settings.wrong_isolation_probability)
        measured = pseudoranges(readings, self._runs, controls.enabled["gps"])
        located, bank = snapshots.levelled(snapshots.locate(state.place, measured), state.bank)
        snapshot = snapshots.take(self._p, measured, located, p_fa, margin)
        m, place, columns = snapshot.measurement, snapshot.place, measured.columns

        prior = filters.predict(bank, self._Phi, self._Q)
        started = prior.started[:, None]
        offset = np.vecmat(place.position_e - place.origin, place.C_en)
        z = (m.y + np.matvec(m.H[..., :3], offset))[:, None]  # counted from the filters' origin
        H, R = filters.design(m.H)[:, None], (m.sigma**2)[:, None]

        held = m.valid & (state.supervisor.health[:, columns] == supervisor.ISOLATED)
        free = m.valid & ~held
        kept = snapshots.judge(m, free, p_fa, margin) if held.any() else snapshot
        survivors = free & ~kept.verdict.excluded if settings.combination == "sequential" else free
        judged = np.stack([m.valid, survivors, m.valid], axis=1) & started[..., None]
        update = kalman.update(prior.x, prior.P, z, H, R, judged)
        form = raim.from_whitened(
            update.whitener[:, :2], update.whitened[:, :2], update.innovation[:, :2], judged[:, :2]
        )
        verdict = raim.isolate(form, p_fa, np.clip(form.dof - 1, 1, REDUNDANT), margin)

        accused, resolved = _combine(settings, m, free, kept, verdict.excluded[:, COMBINED], p_fa)
        supervision, decision = supervisor.step(
            state.supervisor,
            _spread(accused, columns),
            _spread(_admissible(m, held, free & ~accused, resolved, prior, z[:, 0], p_fa), columns),
            _spread(m.valid, columns),
            supervisor.Rules(settings.confirm, settings.within, 1, settings.hold_off),
        )
        trusted = decision.use[:, columns] & m.valid & resolved[:, None]
        clear = np.stack([verdict.state[:, FILTER] != CANNOT_ISOLATE, resolved], axis=1)
        own = m.valid & ~verdict.excluded[:, FILTER] & clear[:, :1]
        waited = np.where(clear | ~started, 0, state.waited + 1)
        lost = waited >= settings.patience
        sets = np.stack([snapshot.fix.valid, own, trusted, m.valid], axis=1)
        sets[:, 1:3] = np.where(started[..., None], sets[:, 1:3], snapshot.fix.valid[:, None])
        fixes = least_squares.solve(m.H[:, None], m.y[:, None], m.sigma[:, None], sets)

        taken = sets[:, 1:] & started[..., None]
        if not np.array_equal(taken, judged):
            update = kalman.update(prior.x, prior.P, z, H, R, taken)
        bank = Bank(update.x, update.P, prior.started)
        agreement = _agreement(prior, fixes, offset, p_fa)
        disagreed = np.where(agreement.alarm, state.disagreed + 1, np.where(agreement.dof > 0, 0, state.disagreed))
        differs = disagreed >= settings.reset_after
        reset = differs | lost[:, COMBINED]
        bank = self._restarted(bank, fixes, offset, lost, differs, snapshot)
        status = _status(snapshot, verdict, fixes, accused | held, resolved, agreement.alarm & ~reset, bank.started)
        after = NavigatorState(
            place=snapshots.advance(snapshot),
            bank=bank,
            supervisor=supervision,
            disagreed=np.where(reset, 0, disagreed),
            waited=np.where(lost, 0, waited),
            status=status[:, COMBINED + 1],
        )
        detail = Detail(
            position_e=_positions(place, snapshot, bank),
            sigma=_sigmas(snapshot, bank),
            status=status,
            satellites=np.count_nonzero(sets, axis=-1),
            hdop=least_squares.hdop(m.H, snapshot.fix.valid, snapshot.everyone.solved),
            dof=snapshot.fix.dof,
            protection=protect(fixes, m.sigma, sets, settings),
            alert_limit=settings.alert_limit,
            columns=columns,
            unit_n=np.where(m.valid[..., None], m.unit_n, np.nan),
            normalised=np.stack([snapshot.form.normalised, form.normalised[:, FILTER]], axis=1),
            trusted=trusted,
            time=float(measured.time),
        )
        output = Output(
            *_tests(snapshot, form, verdict, agreement, columns, p_fa),
            *_health(decision, after.status, trusted, columns),
            _notices(state.status, after.status, reset, agreement),
            detail,
            left_out=self._below_mask(readings, place, state.place.known),
        )
        return after, output

    def _below_mask(self, readings: Readings, place: Place, known: Flags) -> dict[str, LeftOut]:
        """What of a log is never looked at; the simulated receiver does not even hear it.

        A first fix, where the place is not ``known (runs,)`` before, looks at all there are.
        """
        if self._p.log is None:
            return {}
        # Neither an unknown place nor a satellite without an orbit has a direction.
        anywhere = np.where(known[:, None], place.position_e, np.array([earth.A, 0.0, 0.0]))
        seen = least_squares.geometry(anywhere, place.C_en, readings.aiding["satellites"])
        low = least_squares.elevation(seen.unit_n) <= math.radians(self._p.mask)
        return {"gps.pseudorange": LeftOut(low & known[:, None], "the satellite is below the elevation mask")}

    def _restarted(
        self, bank: Bank, fixes: Fix, offset: Array, lost: Flags, differs: Flags, snapshot: Snapshot
    ) -> Bank:
        """Filters that start, or start again, from a snapshot of their own or of others' satellites.

        ``lost`` (runs, 2): filter and combined filter have taken nothing for too long. That is from what the snapshot
        leaves where it has passed its test, or else from everyone: with the culprit in it, a filter that is lost
        would be lost again. ``differs`` (runs,): the combined filter has disagreed with its own satellites for too
        long.
        """
        first = ~bank.started & (snapshot.status != CANNOT_ISOLATE)
        sound = snapshot.sound[:, None]
        for which, where, source in (
            (FILTER, (lost & sound)[:, FILTER], SURVIVORS),
            (COMBINED, (lost & sound)[:, COMBINED], SURVIVORS),
            (FILTER, (lost & ~sound)[:, FILTER], EVERYONE),
            (COMBINED, (lost & ~sound)[:, COMBINED], EVERYONE),
            (COMBINED, differs, COMBINED + 1),
            (FILTER, first, FILTER + 1),
            (COMBINED, first, COMBINED + 1),
            (UNPROTECTED, first, EVERYONE),
        ):
            if where.any():
                at = np.concatenate([fixes.x[:, source, :3] + offset, fixes.x[:, source, 3:]], axis=-1)
                sure = where & fixes.solved[:, source]
                bank = filters.restart(bank, which, sure, at, fixes.covariance[:, source], self._p.filter)
        return bank


def _combine(
    settings: Settings, m: Measurement, free: Flags, kept: Judgement, by_innovation: Flags, p_fa: float
) -> tuple[Flags, Flags]:
    """Who is accused by both tests together (runs, n), and where measurements may be taken at all (runs,).

    Both tests look at the satellites that are ``free``, not held out. Where the snapshot knows that something is wrong
    but not who, the innovations may know: they are believed if the rest then agrees. If not, nothing is taken.
    """
    by_snapshot = kept.verdict.excluded
    accused = by_snapshot & by_innovation if settings.combination == "and" else by_snapshot | by_innovation
    doubtful = kept.status == CANNOT_ISOLATE
    if not doubtful.any():
        return accused, ~doubtful
    rest = least_squares.solve(m.H, m.y, m.sigma, free & ~by_innovation)
    passed = (rest.dof > 0) & (rest.statistic < chi_square.threshold(p_fa, rest.dof))
    helped = doubtful & by_innovation.any(axis=-1) & passed
    return np.where(doubtful[:, None], by_innovation & helped[:, None], accused), ~doubtful | helped


def _admissible(
    m: Measurement, held: Flags, others: Flags, resolved: Flags, prior: Bank, z: Array, p_fa: float
) -> Flags:
    """Which satellites agree with an estimate that they had no part in; who was never held out needs no such proof.

    That is a snapshot of ``others`` (runs, n). Where these are too few for one, it is the combined filter's prediction:
    its covariance grows while nothing better is known, so nobody stays out for ever.
    """
    if not held.any():
        return m.valid
    fix = least_squares.solve(m.H, m.y, m.sigma, others)
    alone = fix.solved[:, None]
    x = np.where(alone, fix.x, prior.x[:, COMBINED, PLACE])
    P = np.where(alone[..., None], fix.covariance, prior.P[:, COMBINED][:, PLACE[:, None], PLACE])
    residual = np.where(alone, m.y, z) - np.matvec(m.H, x)
    variance = m.sigma**2 + np.vecdot(m.H @ P, m.H)
    like = (residual**2 <= chi_square.threshold(p_fa, 1) * variance) & resolved[:, None]
    return np.asarray(m.valid & (like | ~held))


def _agreement(prior: Bank, fixes: Fix, offset: Array, p_fa: float) -> Agreement:
    """d' (P_snapshot + P_prediction)^-1 d of position and clock, where the snapshot of its own satellites is sound."""
    i = COMBINED + 1
    x = fixes.x[:, i].copy()
    x[:, :3] += offset
    tested = prior.started & (fixes.dof[:, i] > 0)
    sound = fixes.statistic[:, i] < chi_square.threshold(p_fa, fixes.dof[:, i])
    d = x - prior.x[:, COMBINED, PLACE]
    W = fixes.covariance[:, i] + prior.P[:, COMBINED][:, PLACE[:, None], PLACE]
    statistic = np.vecdot(d, np.linalg.solve(W, d[..., None])[..., 0])
    dof, limit, alarm = chi_square.decide(statistic, np.where(tested & sound, len(PLACE), 0), p_fa)
    return Agreement(np.where(dof > 0, statistic, 0.0), dof, limit, alarm)


def _status(
    snapshot: Snapshot,
    verdict: Isolation,
    fixes: Fix,
    excluded: Flags,
    resolved: Flags,
    disagrees: Flags,
    started: Flags,
) -> Codes:
    """Codes of :mod:`ftcore.detection.raim` for the four estimators, (runs, 4); the unprotected one knows of nothing.

    A filter whose satellites do not check each other is not vouched for, whatever its prediction says of them: that is
    what a slow fault would have carried away.
    """
    own, both = verdict.state[:, FILTER], np.where(excluded.any(axis=-1), EXCLUDED, CONSISTENT)
    blind = fixes.dof[:, 1:3] <= 0
    own = np.where(blind[:, 0] & (own != CANNOT_ISOLATE), CANNOT_DETECT, own)
    doubt = ~resolved | disagrees | (verdict.state[:, COMBINED] == CANNOT_ISOLATE)
    both = np.where(doubt, CANNOT_ISOLATE, np.where(blind[:, 1], CANNOT_DETECT, both))
    every = np.stack([snapshot.status, own, both, np.full(len(own), CONSISTENT)], axis=-1)
    every[:, 1:] = np.where(started[:, None], every[:, 1:], NO_FIX)
    return every.astype(np.int8)


def _positions(place: Place, snapshot: Snapshot, bank: Bank) -> Array:
    """Earth-fixed positions of the four estimators (runs, 4, 3) [m]; NaN where there is none."""
    at = place.position_e + np.matvec(place.C_en, snapshot.fix.x[:, :3])
    alone = np.where(snapshot.everyone.solved[:, None], at, np.nan)
    kept = place.origin[:, None] + np.matvec(place.C_en[:, None], bank.x[..., PLACE[:3]])
    kept = np.where(bank.started[:, None, None], kept, np.nan)
    return np.concatenate([alone[:, None], kept], axis=1)


def _sigmas(snapshot: Snapshot, bank: Bank) -> Array:
    """1-sigma east, north, up of the four estimators (runs, 4, 3) [m]."""
    alone = np.diagonal(snapshot.fix.covariance, axis1=-2, axis2=-1)[:, None, :3]
    alone = np.where(snapshot.everyone.solved[:, None, None], alone, np.nan)
    kept = np.diagonal(bank.P, axis1=-2, axis2=-1)[..., PLACE[:3]]
    kept = np.where(bank.started[:, None, None], kept, np.nan)
    return np.asarray(np.sqrt(np.concatenate([alone, kept], axis=1)))


def _spread(values: Flags, columns: NDArray[np.intp]) -> Flags:
    """(runs, n) over all satellites that there are."""
    wide = np.zeros((len(values), len(SATELLITES)), bool)
    wide[:, columns] = values
    return wide


def _tests(
    snapshot: Snapshot,
    form: Consistency,
    verdict: Isolation,
    agreement: Agreement,
    columns: NDArray[np.intp],
    p_fa: float,
) -> tuple[Array, Array, Array, Flags]:
    """Statistic, threshold, dof and alarm of all tests; NaN where a test has nothing to judge.

    A satellite's statistic is its residual against all others; it alarms where the test of all does and names it.
    """
    runs, satellites = len(snapshot.status), len(SATELLITES)
    single = chi_square.threshold(p_fa, 1)
    statistic, limit, dof, alarm = [], [], [], []
    for whole, isolation, i in ((snapshot.form, snapshot.verdict, None), (form, verdict, FILTER)):
        at = (slice(None),) if i is None else (slice(None), i)
        degrees = whole.dof[at]
        statistic.append(np.where(degrees > 0, whole.statistic[at], np.nan)[:, None])
        limit.append(isolation.threshold[at][:, None])
        dof.append(degrees[:, None])
        alarm.append(isolation.alarm[at][:, None])
        own = np.full((runs, satellites), np.nan)
        own[:, columns] = np.where(degrees[:, None] > 0, whole.normalised[at] ** 2, np.nan)
        statistic.append(own)
        limit.append(np.where(np.isfinite(own), single, np.nan))
        dof.append(np.isfinite(own))
        alarm.append(_spread(isolation.excluded[at], columns))
    judged = snapshot.form.dof > 0
    statistic += [np.where(judged, snapshot.parity, np.nan)[:, None]]
    statistic += [np.where(agreement.dof > 0, agreement.statistic, np.nan)[:, None]]
    limit += [snapshot.verdict.threshold[:, None], agreement.limit[:, None]]
    dof += [snapshot.form.dof[:, None], agreement.dof[:, None]]
    alarm += [(judged & (snapshot.parity >= snapshot.verdict.threshold))[:, None], agreement.alarm[:, None]]
    return (
        np.concatenate(statistic, axis=-1),
        np.concatenate(limit, axis=-1),
        np.concatenate(dof, axis=-1).astype(np.float64),
        np.concatenate(alarm, axis=-1),
    )


def _health(
    decision: supervisor.Decision, status: Codes, trusted: Flags, columns: NDArray[np.intp]
) -> tuple[Codes, Flags]:
    """Health and use of the receiver as a whole, then of each satellite."""
    whole = np.where(status > EXCLUDED, supervisor.SUSPECT, supervisor.HEALTHY)
    health = np.concatenate([whole[:, None], decision.health], axis=-1).astype(np.int8)
    return health, np.concatenate([trusted.any(axis=-1, keepdims=True), _spread(trusted, columns)], axis=-1)


_ANNOUNCED = {
    CANNOT_ISOLATE: "integrity.cannot-isolate",
    CANNOT_DETECT: "integrity.cannot-detect",
    NO_FIX: "integrity.no-fix",
}


def _notices(before: Codes, now: Codes, reset: Flags, agreement: Agreement) -> list[Notice]:
    """What happened to the combined solution."""
    numbers = {"statistic": agreement.statistic, "threshold": agreement.limit}
    notices = [Notice("filter.reset", "gps", reset, numbers)] if reset.any() else []
    if np.array_equal(before, now):
        return notices
    for code, kind in _ANNOUNCED.items():
        turned = (now == code) & (before != code)
        if turned.any():
            notices.append(Notice(kind, "gps", turned, {}))
    good, was_good = now <= EXCLUDED, before <= EXCLUDED
    if (good & ~was_good).any():
        notices.append(Notice("integrity.restored", "gps", good & ~was_good, {}))
    return notices
