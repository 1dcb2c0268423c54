"""What one fault did, from its rows: noticed, named, who was wronged meanwhile, what it cost.

Delays are medians over the runs; shares are of the runs in which the fault acted. Whoever was in alarm, or out, before
that, is neither found by this fault nor missed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.description import SystemDescription, Test
from ftcore.score.models import FaultScore, Outcome, Share
from ftcore.score.rows import FaultFacts
from ftcore.score.shares import share
from ftcore.score.tables import Table

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

ACTED = "runs in which it acted"
OUT = "runs in which it was out when the fault ended"


@dataclass(frozen=True)
class Seen:
    """One thing that can happen to a fault, run by run.

    Attributes:
        delay: ``(runs,)`` from the first epoch in which the fault acted [s]; NaN where it did not happen.
        already: ``(runs,)`` it was so before.
    """

    delay: Array
    already: Flags

    def outcome(self, acted: Flags) -> Outcome:
        """Over the runs ``(runs,)`` in which the fault acted."""
        happened = np.isfinite(self.delay) & acted
        already = self.already & acted
        of = int(acted.sum())
        return Outcome(
            after_onset=share(int(happened.sum()), of, ACTED),
            already=share(int(already.sum()), of, ACTED),
            missed=share(of - int((happened | already).sum()), of, ACTED),
            delay=float(np.median(self.delay[happened])) if happened.any() else None,
        )


def together(seen: list[Seen]) -> Seen:
    """The first of several: found by whoever noticed first, already in alarm only where nobody else found it."""
    delay = np.fmin.reduce([s.delay for s in seen])
    return Seen(delay, np.any([s.already for s in seen], axis=0) & np.isnan(delay))


@dataclass(frozen=True)
class Told:
    """One fault's part of the score, and run by run what the strip makes its own sums of."""

    acted: Flags
    score: FaultScore
    alarms: dict[str, Seen]
    isolation: Seen
    worst_since: dict[str, Array]


def tell(facts: FaultFacts, rows: Table, description: SystemDescription) -> Told:
    """Score one fault from its rows, one per run."""
    acted: Flags = rows["acted"]
    alarms = {t: Seen(rows[f"alarm_delay.{t}"], rows[f"alarm_before.{t}"]) for t in facts.watched}
    isolation = Seen(rows["isolation_delay"], rows["isolated_before"])
    since = {name: rows[f"worst_since.{name}"] for name in description.score_headline}
    score = FaultScore(
        id=facts.id,
        label=facts.label,
        channel=facts.channel,
        sensor=facts.sensor,
        start=facts.start,
        end=facts.end,
        acted=share(int(acted.sum()), len(rows), "runs"),
    )
    if acted.any():
        score = score.model_copy(update=_of_one_that_acted(facts, rows, alarms, isolation, description))
        score = score.model_copy(update={"words": words(score, description)})
    else:
        because = str(rows["silent_because"][0])
        score = score.model_copy(update={"silent_because": because, "words": f"never acted: {because}"})
    return Told(acted, score, alarms, isolation, since)


def _of_one_that_acted(
    facts: FaultFacts, rows: Table, alarms: dict[str, Seen], isolation: Seen, description: SystemDescription
) -> dict[str, object]:
    """Fields of the score of a fault that acted in a run at least."""
    acted: Flags = rows["acted"]
    of = int(acted.sum())
    outcomes = {name: seen.outcome(acted) for name, seen in alarms.items()}
    isolated = isolation.outcome(acted)
    wronged = {
        name.removeprefix("wrong."): rows[name] for name in rows if name.startswith("wrong.") and rows[name].any()
    }
    wrong = share(int(np.any(list(wronged.values()), axis=0).sum()) if wronged else 0, of, ACTED)
    at_end, back = int(rows["out_at_end"].sum()), rows["readmission_delay"]
    worst = {name: largest(rows[f"worst.{name}"]) for name in description.score_headline}
    return {
        "first_acted": float(np.median(rows["first_acted"][acted])),
        "time_to_alarm": {name: outcome.delay for name, outcome in outcomes.items()},
        "alarmed_share": {name: _not_missed(outcome) for name, outcome in outcomes.items()},
        "alarms": outcomes,
        "time_to_isolate": isolated.delay,
        "isolated_share": _not_missed(isolated),
        "isolation": isolated,
        "isolated": sorted(s for s in facts.explained if rows[f"isolated.{s}"].any()),
        "wrong_isolations": sorted(wronged),
        "wrong_share": wrong.share,
        "wrong": wrong,
        "time_to_readmit": float(np.nanmedian(back)) if np.isfinite(back).any() else None,
        "readmission": share(int(np.isfinite(back).sum()), at_end, OUT) if at_end else None,
        "worst": {name: value for name, value in worst.items() if value is not None},
    }


def largest(values: Array) -> float | None:
    """Largest of the numbers; None where there is none at all."""
    return float(np.nanmax(values)) if np.isfinite(values).any() else None


def _not_missed(outcome: Outcome) -> float:
    """Share of the runs in which it was so while the fault acted, since its onset or already before."""
    return (outcome.missed.of - outcome.missed.count) / outcome.missed.of


def watching(description: SystemDescription) -> list[Test]:
    """Tests by which the system itself can find a fault."""
    return [test for test in description.tests if not test.baseline]


def words(score: FaultScore, description: SystemDescription) -> str:
    """One line about a fault that acted: found, named, who was wronged, each with its denominator."""
    single = score.acted.of == 1

    def counted(share: Share) -> str:
        return "" if single else f" in {share.words}"

    labels = {test.name: test.label for test in description.tests}
    alarms = {test.name: score.alarms[test.name] for test in watching(description) if test.name in score.alarms}
    noticed = [(name, o) for name, o in alarms.items() if o.delay is not None]
    noticed.sort(key=lambda pair: (-pair[1].after_onset.count, pair[1].delay))
    parts = [] if single else [f"acted in {score.acted.words}"]
    if noticed:
        name, best = noticed[0]
        parts.append(f"noticed by {labels[name]} after {best.delay:g} s{counted(best.after_onset)}")
    elif any(o.already.count for o in alarms.values()):
        name, best = max(alarms.items(), key=lambda pair: pair[1].already.count)
        parts.append(f"{labels[name]} already in alarm{counted(best.already)}")
    else:
        parts.append("not noticed by any test")
    if score.isolation is not None:
        out = score.isolation
        if out.delay is not None:
            parts.append(f"{', '.join(score.isolated)} isolated after {out.delay:g} s{counted(out.after_onset)}")
        if out.already.count:
            parts.append(f"isolated already{counted(out.already)}")
        if out.missed.count == out.missed.of:
            parts.append("nobody isolated for it")
    if score.wrong is not None and score.wrong.count:
        parts.append(f"wrongly isolated meanwhile: {', '.join(score.wrong_isolations)}{counted(score.wrong)}")
    return "; ".join(parts)
