"""The score strip: the faults, found and named; false alarms and false isolations; worst error; consistency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ftcore import units
from ftcore.description import SystemDescription
from ftcore.score import intervals
from ftcore.score.healthy import of_alarms
from ftcore.score.models import EstimatorScore, Headline, IsolationScore, TestScore
from ftcore.score.names import called
from ftcore.score.per_fault import Seen, Told, largest, together, watching
from ftcore.score.rows import Rows
from ftcore.score.shares import number

Flags = NDArray[np.bool_]

NAMED = 3
"""Names that a note has room for."""


def strip(
    rows: Rows,
    faults: Sequence[Told],
    tests: Sequence[TestScore],
    isolations: Sequence[IsolationScore],
    estimators: Mapping[str, EstimatorScore],
) -> list[Headline]:
    """All items, in the order in which they are shown."""
    runs, description = len(rows.runs), rows.description
    items = [*_of_faults(description, faults, runs), _of_alarms(description, tests), _of_isolations(isolations, runs)]
    if len(description.score_headline) > 1 and rows.time > 0.0:
        items.append(_of_error(rows, faults))
    consistent = next((e for e in estimators.values() if e.nees is not None), None)
    if consistent is not None and consistent.nees_dof:
        value = float(consistent.nees or 0.0) / float(consistent.nees_dof)
        items.append(Headline(label="Consistency (NEES / dof)", value=value, unit="", note="1 is consistent"))
    return items


def _of_faults(description: SystemDescription, faults: Sequence[Told], runs: int) -> list[Headline]:
    """Found and isolated: after how long where one sensor failed, how many where several did or one again."""
    waiting = ("Fault found after", "Isolated after")
    detail = ". ".join(f"{told.score.label}: {told.score.words}" for told in faults)
    if not faults:
        return [Headline(label=label, value=None, unit="s", note="no fault yet") for label in waiting]
    failures: dict[tuple[str, float], list[Told]] = {}
    for told in faults:
        if told.acted.any():
            failures.setdefault((told.score.sensor, told.score.start), []).append(told)
    silent = len([told for told in faults if not told.acted.any()])
    if not failures:
        why = faults[0].score.words if len(faults) == 1 else f"{number(silent, 'fault', 'faults')} never acted"
        return [Headline(label=label, value=None, unit="s", note=why, detail=detail) for label in waiting]
    quiet = [f"{number(silent, 'other', 'others')} never acted"] if silent else []
    whom = _whom(description, faults)
    acted = [np.any([t.acted for t in group], axis=0) for group in failures.values()]
    ours = [test.name for test in watching(description)]
    found = [
        together([t.alarms[name] for t in group for name in ours if name in t.alarms] or [_nothing(runs)])
        for group in failures.values()
    ]
    out = [together([t.isolation for t in group]) for group in failures.values()]
    if len(failures) == 1:
        (group,) = failures.values()
        noticed = [*_noticed(description, group, found[0], acted[0], runs), *quiet]
        named = [*_counted(out[0], acted[0], runs), *whom]
        return [
            Headline(label=label, value=seen.outcome(acted[0]).delay, unit="s", note="; ".join(note), detail=detail)
            for label, seen, note in zip(waiting, (found[0], out[0]), (noticed, named), strict=True)
        ]
    items = []
    for label, seen, note in (("Faults found", found, quiet), ("Isolated", out, whom)):
        outcomes = [s.outcome(a) for s, a in zip(seen, acted, strict=True)]
        hits, of = (sum(o.after_onset.count for o in outcomes), sum(o.after_onset.of for o in outcomes))
        already = sum(o.already.count for o in outcomes)
        words = [f"{already} already {'in alarm' if seen is found else 'out'} before"] if already else []
        if runs > 1:
            each = ", ".join(f"{o.after_onset.count} of {o.after_onset.of}" for o in outcomes)
            words.insert(0, f"{each} runs in which they acted")
        elif seen is found:
            delays = [o.delay for o in outcomes if o.delay is not None]
            words.insert(0, f"the slowest after {max(delays):g} s" if delays else "none noticed yet")
        items.append(
            Headline(label=f"{label}, of {of}", value=float(hits), unit="", note="; ".join(words + note), detail=detail)
        )
    return items


def _nothing(runs: int) -> Seen:
    return Seen(np.full(runs, np.nan), np.zeros(runs, bool))


def _whom(description: SystemDescription, faults: Sequence[Told]) -> list[str]:
    """Who was named, rightly and wrongly."""
    named = sorted({called(description, s) for told in faults for s in told.score.isolated})
    wrong = sorted({called(description, s) for told in faults for s in told.score.wrong_isolations})
    words = [f"{', '.join(named)} named"] if named else []
    words += [f"wrongly: {', '.join(wrong)}"] if wrong else []
    return words or ["nobody isolated"]


def _counted(seen: Seen, acted: Flags, runs: int) -> list[str]:
    """In how many runs it happened, and in how many it was so before; nothing to count in a single run that it did."""
    outcome = seen.outcome(acted)
    if runs > 1:
        words = [f"in {outcome.after_onset.words}"]
        return words + ([f"in {outcome.already.count} out before"] if outcome.already.count else [])
    return ["out before it acted"] if outcome.already.count else []


def _noticed(description: SystemDescription, group: Sequence[Told], found: Seen, acted: Flags, runs: int) -> list[str]:
    """Which tests noticed first, or that they were in alarm already."""
    labels = {test.name: test.label for test in description.tests}
    tests = [test.name for test in watching(description) if any(test.name in told.alarms for told in group)]
    each = {name: together([told.alarms[name] for told in group if name in told.alarms]) for name in tests}
    delays = {name: d for name, seen in each.items() if (d := seen.outcome(acted).delay) is not None}
    order = sorted(delays, key=lambda name: delays[name])
    outcome = found.outcome(acted)
    words = [f"in {outcome.after_onset.words}"] if runs > 1 else []
    if order:
        words.append(labels[order[0]])
        words += [f"{labels[name]} {delays[name]:g} s" for name in order[1:3]]
    already = [labels[name] for name, seen in each.items() if (seen.already & acted).any()]
    if already and (runs > 1 or not order):
        more = f" and {len(already) - NAMED} more" if len(already) > NAMED else ""
        where = f" in {outcome.already.count} runs" if runs > 1 and outcome.already.count else ""
        words.append(f"already in alarm{where}: {', '.join(already[:NAMED])}{more}")
    return words or ["not noticed yet"]


def _of_alarms(description: SystemDescription, tests: Sequence[TestScore]) -> Headline:
    """False alarms of all tests that may decide."""
    drives = {test.name for test in description.tests if test.may_drive}
    counted = [t for t in tests if t.name in drives]
    alarms, epochs = sum(t.alarms for t in counted), sum(t.epochs for t in counted)
    note = "no test of a sound sensor so far"
    if epochs:
        low, high = intervals.of_share(alarms, epochs)
        rate = intervals.percent(alarms / epochs)
        note = f"of {epochs} tests of sound sensors: {rate} % ({intervals.between(low, high)})"
        if any(t.clustered for t in counted):
            note += f"; in {number(sum(t.stretches for t in counted), 'stretch', 'stretches')}"
    detail = f"{of_alarms(counted)}. What a fault explains counts as recovering for {description.recovery:g} s after it"
    return Headline(label="False alarms", value=float(alarms), unit="", note=note, detail=detail)


def _of_isolations(isolations: Sequence[IsolationScore], runs: int) -> Headline:
    """Isolations of the sound: whom, when or in how many runs, and in how many hours of use."""
    count, hours = sum(s.count for s in isolations), sum(s.hours for s in isolations)
    exposure = f"in {hours:.3g} sensor-hours of use"
    if hours:
        low, high = (intervals.figure(x) for x in intervals.of_rate(count, hours))
        exposure += f" (95 %: {low} to {high} an hour)" if count else f" (95 %: at most {high} an hour)"
    hit = sorted((s for s in isolations if s.count), key=lambda s: -s.count)
    words = []
    for score in hit[:NAMED]:
        if runs > 1:
            words.append(f"{score.label} in {score.runs.words}")
        else:
            times = ", ".join(f"{w.time:g}" for w in score.first[:NAMED])
            words.append(f"{score.label} at {times}{' ...' if score.count > NAMED else ''} s")
    if len(hit) > NAMED:
        words.append(f"{len(hit) - NAMED} more")
    detail = ". ".join(f"{score.label}: {score.words}" for score in hit) or f"nobody isolated wrongly {exposure}"
    return Headline(
        label="False isolations", value=float(count), unit="", note="; ".join([*words, exposure]), detail=detail
    )


def _of_error(rows: Rows, faults: Sequence[Told]) -> Headline:
    """Worst error since the first fault that acted, beside the unprotected twin's; since settling without one."""
    description = rows.description
    mine, twin = description.score_headline[:2]
    first = min((told for told in faults if told.acted.any()), key=lambda told: told.score.start, default=None)
    unit = next(signal.unit for signal in description.signals if signal.name == mine)
    found = [
        largest(rows.flights[f"worst.{name}"] if first is None else first.worst_since[name]) for name in (mine, twin)
    ]
    value, compare = (None if x is None else units.from_si(x, unit) for x in found)
    return Headline(
        label=description.score_label,
        value=value,
        unit=unit,
        note="since the filters settled" if first is None else "since the first fault",
        compare_label=description.estimators.get(twin.split(".")[0], twin),
        compare=compare,
    )
