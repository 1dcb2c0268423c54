"""What one fault did: when which test noticed, when the culprit was named, who was wronged meanwhile, what it cost.

Delays count, in each run, from the first epoch in which the fault acted; shares are of the runs in which it did.
Whoever was in alarm, or out, before that, is neither found by this fault nor missed. A fault is found and named while
it acts; one epoch more is allowed, as a decision may take the epoch after the last bad reading.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.description import SystemDescription, Test
from ftcore.faults import KINDS, ChannelAddress, Fault
from ftcore.recording import Recording
from ftcore.score.blame import Cause, Judge
from ftcore.score.errors import worst as worst_of
from ftcore.score.history import SLACK, Spells, first_between
from ftcore.score.models import FaultScore, Outcome, Share
from ftcore.score.shares import share

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

    cause: Cause
    score: FaultScore
    alarms: dict[str, Seen]
    isolation: Seen


def tell(
    cause: Cause,
    judge: Judge,
    recording: Recording,
    description: SystemDescription,
    channels: Mapping[str, ChannelAddress],
    silent_because: str | None,
) -> Told:
    """Score one fault; ``silent_because`` is said where it never acted."""
    named = {subject: spells for subject, spells in judge.history.isolated.items() if cause.explains(subject)}
    until = cause.last + recording.period
    alarms = _alarms(cause, judge, description, until)
    isolation = _seen(
        cause,
        [spells.at(cause.first) for spells in named.values()],
        [first_between(spells.run, spells.since, cause.first, until) for spells in named.values()],
    )
    score = _blank(cause, judge.runs, channels)
    acted = cause.acted
    if not acted.any():
        because = silent_because or "it has changed no reading so far"
        return Told(
            cause,
            score.model_copy(update={"silent_because": because, "words": f"never acted: {because}"}),
            alarms,
            isolation,
        )
    outcomes = {name: seen.outcome(acted) for name, seen in alarms.items()}
    isolated = isolation.outcome(acted)
    wronged = _wronged(cause, judge)
    at_end, back = _readmitted(cause, named, recording)
    hit = np.any(list(wronged.values()), axis=0) if wronged else np.zeros(judge.runs, bool)
    wrong = share(int(hit.sum()), int(acted.sum()), ACTED)
    score = score.model_copy(
        update={
            "first_acted": float(np.median(cause.first[acted])),
            "time_to_alarm": {name: outcome.delay for name, outcome in outcomes.items()},
            "alarmed_share": {name: _not_missed(outcome) for name, outcome in outcomes.items()},
            "alarms": outcomes,
            "time_to_isolate": isolated.delay,
            "isolated_share": _not_missed(isolated),
            "isolation": isolated,
            "isolated": sorted(
                name
                for name, spells in named.items()
                if np.isfinite(first_between(spells.run, spells.since, cause.first, until)).any()
            ),
            "wrong_isolations": sorted(wronged),
            "wrong_share": wrong.share,
            "wrong": wrong,
            "time_to_readmit": float(np.nanmedian(back)) if np.isfinite(back).any() else None,
            "readmission": share(int(np.isfinite(back).sum()), int(at_end.sum()), OUT) if at_end.any() else None,
            "worst": _cost(cause.fault, recording, description),
        }
    )
    return Told(cause, score.model_copy(update={"words": words(score, description)}), alarms, isolation)


def _not_missed(outcome: Outcome) -> float:
    """Share of the runs in which it was so while the fault acted, since its onset or already before."""
    return (outcome.missed.of - outcome.missed.count) / outcome.missed.of


def _blank(cause: Cause, runs: int, channels: Mapping[str, ChannelAddress]) -> FaultScore:
    """What there is to say of a fault that never acted."""
    fault = cause.fault
    assert fault.start is not None
    unit = fault.unit or KINDS[fault.kind].unit(channels[fault.channel].unit)
    return FaultScore(
        id=str(fault.id),
        label=label(fault, unit),
        channel=fault.channel,
        sensor=cause.sensor,
        start=fault.start,
        end=fault.end,
        acted=share(int(cause.acted.sum()), runs, "runs"),
    )


def _alarms(cause: Cause, judge: Judge, description: SystemDescription, until: Array) -> dict[str, Seen]:
    """What each test that looks at an explained subject said of the fault, up to ``until (runs,)``."""
    found = {}
    for test in description.tests:
        explained = [subject for subject in test.subjects if cause.explains(subject)]
        edges = [e for subject in explained if (e := judge.history.alarms.get((test.name, subject))) is not None]
        if explained:
            found[test.name] = _seen(
                cause, [e.at(cause.first) for e in edges], [e.first_between(cause.first, until) for e in edges]
            )
    return found


def _seen(cause: Cause, before: list[Flags], since: list[Array]) -> Seen:
    """From what was so before the fault acted, and when it became so since, ``(runs,)`` each, of several subjects."""
    runs = len(cause.first)
    already = np.any([np.zeros(runs, bool), *before], axis=0)
    least = np.fmin.reduce([np.full(runs, np.nan), *since])
    return Seen(np.where(already, np.nan, least - cause.first), already)


def _cost(fault: Fault, recording: Recording, description: SystemDescription) -> dict[str, float]:
    """Worst of the headline's errors from the start of the fault to its end."""
    assert fault.start is not None
    end = np.inf if fault.end is None else fault.end
    lo, hi = np.searchsorted(recording.time, [fault.start - SLACK, end + SLACK])
    found = {name: worst_of(recording.rows[lo:hi, :, recording.column[name]]) for name in description.score_headline}
    return {name: value for name, value in found.items() if value is not None}


def label(fault: Fault, unit: str | None) -> str:
    """What a person calls a fault."""
    size = "" if unit is None else f" {fault.magnitude:g} {unit}"
    return f"{fault.channel} {KINDS[fault.kind].label}{size}"


def _wronged(cause: Cause, judge: Judge) -> dict[str, Flags]:
    """Subject -> runs ``(runs,)`` in which it was isolated wrongly while the fault, or its traces, were there."""
    end = cause.last + judge.recovery
    found = {}
    for subject, spells in judge.history.isolated.items():
        inside = (spells.since >= cause.first[spells.run] - SLACK) & (spells.since <= end[spells.run] + SLACK)
        hit = inside & judge.wrong(subject)
        if hit.any():
            found[subject] = np.zeros(judge.runs, bool)
            found[subject][spells.run[hit]] = True
    return found


def _readmitted(cause: Cause, named: Mapping[str, Spells], recording: Recording) -> tuple[Flags, Array]:
    """Runs in which a culprit was out when the fault ended, and how long until it was back [s], ``(runs,)`` each."""
    runs = len(cause.first)
    at_end, back = np.zeros(runs, bool), np.full(runs, np.nan)
    if cause.fault.end is None or cause.fault.end > recording.time[-1] + SLACK:
        return at_end, back
    end = np.where(cause.acted, cause.fault.end, np.nan)
    for spells in named.values():
        over = (spells.since <= end[spells.run] + SLACK) & (spells.until >= end[spells.run] - SLACK)
        at_end[spells.run[over]] = True
        returned = over & spells.readmitted
        delay = spells.until[returned] - end[spells.run[returned]]
        np.fmin.at(back, spells.run[returned], delay)
    return at_end, back


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
