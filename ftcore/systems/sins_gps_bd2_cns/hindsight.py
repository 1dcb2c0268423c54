"""Back to before the onset: what the filters took in before a culprit was found is taken out again.

When an aid is isolated, or GPS and BD2 fall out with each other, the likelihood ratio over the last minute says who was
wrong and since when (:mod:`.evidence`). From then on the protected part is flown again without the culprit
(:mod:`.protected`), as if the operator had switched it off in time; so nobody else is accused on its account either.

Isolation. The driving test says *that* somebody is wrong; where the ratio names another aid than the one whose alarm
was confirmed, that one is isolated instead. The state form begins to see a fault when the filter has taken it in: then
the sound aids contradict the filter too, so its isolations stand only if the ratio agrees. One by the innovation form
stands also where the ratio is silent; then the fault began at most as many epochs ago as confirmation takes.

Disagreement. Two receivers have fallen out and are both still believed, or the star tracker reads what the filter
cannot have expected: somebody was taken in that should not have been. What the ratio names is taken out up to now. It
is not isolated, that is for the driving test to say; so this may happen again every `REST` epochs.

Slips. Where the weights alone decide (Yang 2016), an isolated aid slips in now and then. That is taken out every
`SPACING` epochs, and when it is readmitted.

Onset. A fault that grows is fitted best by a step that begins when a third of its time is over, so half of the time
since the step is added, and `MARGIN` epochs.

Source: FTLab's own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import chi_square, recovery, supervisor
from ftcore.systems import past as kept
from ftcore.systems.base import Flags
from ftcore.systems.past import SPACING, Flight, Past, of_runs, with_runs
from ftcore.systems.sins_gps_bd2_cns import evidence, exclusion, protected
from ftcore.systems.sins_gps_bd2_cns.aids import AIDS
from ftcore.systems.sins_gps_bd2_cns.branch import STARS, Measured
from ftcore.systems.sins_gps_bd2_cns.error_model import ErrorModel
from ftcore.systems.sins_gps_bd2_cns.forms import Settings
from ftcore.systems.sins_gps_bd2_cns.protected import Epoch, Outcome, Protected

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MARGIN = 2
"""Epochs before the onset that are not trusted either."""
REST = 10
"""Epochs between two looks at a disagreement that goes on."""
FIRST_WORD = 4
"""Epochs of disagreement in which the state form, which is late, may say something first."""
P_UNEXPECTED = 1e-6
"""Tail probability of a reading of the star tracker that is reason to look back."""
PAIR = [0, 1]
"""Places of GPS and BD2, which measure the same."""


@dataclass(frozen=True)
class History:
    """What is remembered: the past, and when a disagreement was last looked into ``(runs,)``."""

    past: Past[Protected, Epoch]
    asked: Ints


@dataclass(frozen=True)
class Review:
    """Who was taken out of the past in this epoch ``(runs, 3)``, and since when ``(runs, 3)``."""

    named: Flags
    since: Ints


def start(runs: int) -> History:
    """Nothing remembered."""
    return History(Past(), np.full(runs, -REST))


def keep(history: History, state: Protected) -> History:
    """Before an epoch."""
    return replace(history, past=kept.keep(history.past, state))


def conclude(history: History, turns: bool, correction: Array | None) -> History:
    """At the end of an epoch: whether the propagators took turns, and what the strapdown was corrected by."""
    *before, last = history.past.epochs
    last = replace(last, turns=turns, correction=correction)
    return replace(history, past=replace(history.past, epochs=(*before, last)))


class Hindsight:
    """Looks back on the epochs of ``runs`` runs. ``R (9,)``: variances of the aids; ``transition``: of the IMM."""

    def __init__(self, runs: int, model: ErrorModel, R: Array, transition: Array) -> None:
        self._runs, self._model, self._R, self._transition = runs, model, R, transition

    def review(
        self, history: History, epoch: Epoch, state: Protected, outcome: Outcome
    ) -> tuple[History, Protected, Outcome, Review | None]:
        """After the decisions of an epoch, before its end: remember it; look back where there is reason to."""
        past = kept.add(history.past, epoch)
        history = replace(history, past=past)
        settings: Settings = epoch.controls.settings
        isolated = outcome.decision.just_isolated
        if settings.driving_test == "none":
            return history, state, outcome, None
        rested = past.now - history.asked >= REST
        doubtful = rested & (_fallen_out(state, outcome, settings) | self._unexpected(epoch, outcome))
        slipped = _slipped(past, outcome, settings)
        asked = isolated.any(axis=-1) | doubtful
        if not (asked.any() or slipped.any()):
            return history, state, outcome, None
        named, since = self._attributed(past, isolated, asked, settings)
        own = state.supervisor
        ruled = _ruled(own, isolated, named, slipped)
        review = Review(named | slipped, np.where(slipped & ~named, past.now - SPACING, since))
        if review.named.any():
            review = replace(review, since=np.clip(review.since, past.first, past.now))
            past, state, made = self.fly_again(past, state, review)
            outcome = self._amended(outcome, made)
            # Who was taken out is judged by what it really read; of the others the new past says what they are.
            here = review.named | ~review.named.any(axis=-1, keepdims=True)
            state = replace(state, supervisor=_chosen(here, own, state.supervisor))
            ruled = np.where(here, ruled, np.int8(-1))
        if (ruled >= 0).any():
            state = protected.rule(state, ruled)
            *before, last = past.epochs
            past = replace(past, epochs=(*before, replace(last, ruled=ruled)))
        health = state.supervisor.health
        decision = replace(outcome.decision, health=health, members=protected.members(health))
        history = History(past, np.where(asked, past.now, history.asked))
        return history, state, replace(outcome, decision=decision), review

    # ---- whether there is reason -------------------------------------------------------------------------------------

    def _unexpected(self, epoch: Epoch, outcome: Outcome) -> Flags:
        """``(runs,)`` where the star tracker, which has no peer, reads what no filter can have expected."""
        q = outcome.examined.updates.residuals.q[:, :, STARS].min(axis=1)
        found = q > chi_square.threshold(P_UNEXPECTED, outcome.examined.updates.dof[:, STARS])
        if found.any():
            m = Measured(epoch.y, epoch.H, self._R, epoch.valid)
            found = found & exclusion.convicts(outcome.examined, m, P_UNEXPECTED, epoch.turned)[:, STARS]
        return np.asarray(found & ~outcome.decision.isolated[:, STARS])

    # ---- who, and since when -----------------------------------------------------------------------------------------

    def _attributed(
        self, past: Past[Protected, Epoch], isolated: Flags, asked: Flags, settings: Settings
    ) -> tuple[Flags, Ints]:
        """Who was wrong ``(runs, 3)`` and since which epoch ``(runs, 3)``, in the runs that ``asked``."""
        named = np.zeros((self._runs, len(AIDS)), bool)
        since = np.full(named.shape, past.now + 1)
        if not asked.any():
            return named, since
        who = np.flatnonzero(asked)
        origin = of_runs(past.banks[0][1], who)
        epochs = [of_runs(e, who) for e in past.epochs]
        found, first = named[who], since[who]
        accused = isolated[who]
        for looks in range(len(AIDS)):
            numbers = np.arange(past.first, past.now + 1)[:, None]
            masked = found[:, None] & (numbers >= first[:, None])
            ratio, age, limit = evidence.weigh(origin, epochs, masked, self._model, self._R)
            candidates = ~found & (accused | (looks == 0))
            ratio = np.where(candidates, ratio, 0.0)
            best = np.arange(len(AIDS)) == ratio.argmax(axis=-1)[:, None]
            new = best & (ratio > limit)
            first = np.where(new, past.now - age - age // 2 - MARGIN, first)
            found = found | new
            if not (new.any(axis=-1) & (accused & ~found).any(axis=-1)).any():
                break
        if settings.driving_test == "two-propagator":
            alone = accused & ~found.any(axis=-1, keepdims=True)
            found = found | alone
            first = np.where(alone, past.now - settings.within - MARGIN, first)
        named[who], since[who] = found, np.clip(first, past.first, past.now + 1)
        return named, since

    # ---- fly it again ------------------------------------------------------------------------------------------------

    def fly_again(
        self, past: Past[Protected, Epoch], state: Protected, review: Review
    ) -> tuple[Past[Protected, Epoch], Protected, list[tuple[Ints, Outcome]]]:
        """The past and the latest ``state`` without those who are named, and what came of the last epoch in which runs.

        ``review.since`` lies within the past.
        """
        made: list[tuple[Ints, Outcome]] = []

        def again(bank: Protected, e: Epoch, number: int, who: Ints) -> tuple[Protected, Epoch]:
            out = review.named[who] & (number >= review.since[who])
            e = replace(e, valid=e.valid & ~np.repeat(out, e.valid.shape[-1] // len(AIDS), axis=-1))
            bank, outcome = protected.again(bank, e, self._model, self._R, self._transition)
            if number == past.now:
                made.append((who, outcome))
            return bank, replace(e, mu=outcome.mu, taken=outcome.used, out=outcome.decision.isolated | out)

        def put(whole: Protected, some: Protected, who: Ints) -> Protected:
            return with_runs(whole, some, who, self._runs)

        def put_epoch(whole: Epoch, some: Epoch, who: Ints) -> Epoch:
            changed = {
                name: with_runs(getattr(whole, name), getattr(some, name), who, self._runs)
                for name in ("valid", "mu", "taken", "out")
            }
            return replace(whole, **changed)

        first = np.where(review.named, review.since, past.now + 1).min(axis=-1)
        flight: Flight[Protected, Epoch] = Flight(of_runs, of_runs, again, put, put_epoch)
        past, state = kept.fly_again(past, state, np.asarray(review.named.any(axis=-1)), first, flight)
        return past, state, made

    def _amended(self, outcome: Outcome, made: list[tuple[Ints, Outcome]]) -> Outcome:
        """The outcome with what came of the runs that were flown again; the tests stay as they were made."""
        for who, new in made:
            changed = {
                name: with_runs(getattr(outcome, name), getattr(new, name), who, self._runs)
                for name in ("decision", "used", "alpha", "beta", "mu", "fused")
            }
            outcome = replace(outcome, **changed)
        return outcome


def _ruled(state: supervisor.State, isolated: Flags, named: Flags, slipped: Flags) -> NDArray[np.int8]:
    """What becomes of the aids ``(runs, 3)``: who was named is out, who was accused instead is a suspect; -1: neither.

    One that had slipped in is what it is, out or back again. Who is named where nobody was isolated yet is out too: its
    past was taken away for it, and its next readings are no better.
    """
    ruled = np.where(slipped, state.health, np.int8(-1))
    ruled = np.where(isolated & ~named, np.int8(supervisor.SUSPECT), ruled)
    return np.where(named, np.int8(supervisor.ISOLATED), ruled)


def _chosen(where: Flags, a: supervisor.State, b: supervisor.State) -> supervisor.State:
    return supervisor.State(
        np.where(where, a.health, b.health),
        np.where(where, a.history, b.history),
        np.where(where, a.streak, b.streak),
    )


def _fallen_out(state: Protected, outcome: Outcome, settings: Settings) -> Flags:
    """``(runs,)`` where GPS and BD2 contradict each other and neither is isolated."""
    watch = state.main.watch
    ago = FIRST_WORD if settings.driving_test == "two-propagator-state" else 0
    apart = (recovery.fallen_out(watch) & recovery.fallen_out(watch, ago)).any(axis=-1)
    return np.asarray(apart & ~outcome.decision.isolated[:, PAIR].any(axis=-1))


def _slipped(past: Past[Protected, Epoch], outcome: Outcome, settings: Settings) -> Flags:
    """``(runs, 3)`` isolated aids that the weights have let in, where it is time to take that out again."""
    nobody = np.zeros_like(outcome.decision.isolated)
    if settings.master == "federated" or settings.exclusion == "isolation":
        return nobody
    back = outcome.decision.just_readmitted
    out = outcome.decision.isolated & (past.now % SPACING == 0) | back
    if not out.any():
        return nobody
    lately = past.epochs[-SPACING:]
    slipped = np.logical_or.reduce([e.taken & e.out for e in lately])
    return np.asarray(out & slipped)
