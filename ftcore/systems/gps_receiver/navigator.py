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
from ftcore.detection import raim, supervisor
from ftcore.detection.raim import CANNOT_ISOLATE, CONSISTENT
from ftcore.estimation import kalman, least_squares
from ftcore.estimation.least_squares import Fix
from ftcore.parts.ledger import Layout, Ledger
from ftcore.readings import Readings
from ftcore.systems.base import Controls, Flags, LeftOut, Output
from ftcore.systems.gps_receiver import bank as filters
from ftcore.systems.gps_receiver import combination, estimators, innovations, integrity, satellites
from ftcore.systems.gps_receiver import snapshot as snapshots
from ftcore.systems.gps_receiver.bank import COMBINED, FILTER, PLACE, UNPROTECTED, Bank
from ftcore.systems.gps_receiver.combination import over_all
from ftcore.systems.gps_receiver.forms import Parameters, Settings
from ftcore.systems.gps_receiver.satellites import SATELLITES, pseudoranges
from ftcore.systems.gps_receiver.snapshot import Place, Snapshot
from ftcore.systems.reporting import output

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


class Navigator:
    """See :class:`ftcore.systems.base.Navigator`."""

    def __init__(self, p: Parameters, runs: int, dt: float, layout: Layout) -> None:
        self._p = p
        self._layout = layout
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

        accused, resolved = combination.accuse(settings, m, free, kept, verdict.excluded[:, COMBINED], p_fa)
        supervision, decision = supervisor.step(
            state.supervisor,
            over_all(accused, columns),
            over_all(combination.admissible(m, held, free & ~accused, resolved, prior, z[:, 0], p_fa), columns),
            over_all(m.valid, columns),
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
        agreement = innovations.agreement(prior, fixes, offset, p_fa)
        disagreed = np.where(agreement.alarm, state.disagreed + 1, np.where(agreement.dof > 0, 0, state.disagreed))
        differs = disagreed >= settings.reset_after
        reset = differs | lost[:, COMBINED]
        bank = self._restarted(bank, fixes, offset, lost, differs, snapshot)
        status = combination.status(
            snapshot, verdict, fixes, accused | held, resolved, agreement.alarm & ~reset, bank.started
        )
        after = NavigatorState(
            place=snapshots.advance(snapshot),
            bank=bank,
            supervisor=supervision,
            disagreed=np.where(reset, 0, disagreed),
            waited=np.where(lost, 0, waited),
            status=status[:, COMBINED + 1],
        )
        say = Ledger(self._layout, self._runs)
        satellites.report(say, measured, m)
        snapshots.report(say, snapshot, columns, p_fa)
        innovations.report(say, form, verdict, agreement, columns, p_fa)
        combination.report(say, decision, after.status, trusted, m.valid, columns)
        at, sigma = _positions(place, snapshot, bank), _sigmas(snapshot, bank)
        estimators.report(say, at, sigma, status, np.count_nonzero(sets, axis=-1))
        integrity.report(say, integrity.protect(fixes, m.sigma, sets, settings), settings.alert_limit, columns)
        events = combination.notices(state.status, after.status, reset, agreement)
        return after, output(say, events, left_out=self._below_mask(readings, place, state.place.known))

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
