"""The row of each run and fault: when which test noticed, when the culprit was named, who was wronged meanwhile.

Delays count, in each run, from the first epoch in which the fault acted. A fault is found and named while it acts; one
epoch more is allowed, as a decision may take the epoch after the last bad reading.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ftcore.description import SystemDescription
from ftcore.faults import KINDS, ChannelAddress, Fault
from ftcore.score.blame import Cause, Judge
from ftcore.score.book import Book
from ftcore.score.flight_rows import Described, si_unit, since, subjects, table, worst
from ftcore.score.history import SLACK, Spells, first_between
from ftcore.score.rows import FaultFacts
from ftcore.score.tables import Column, Table

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

NO_REASON = "it has changed no reading so far"


def facts_of(
    cause: Cause, description: SystemDescription, channels: Mapping[str, ChannelAddress], book: Book
) -> FaultFacts:
    """What is the same of a fault in every run."""
    fault = cause.fault
    assert fault.start is not None
    unit = fault.unit or KINDS[fault.kind].unit(channels[fault.channel].unit)
    return FaultFacts(
        id=str(fault.id),
        label=label(fault, unit),
        channel=fault.channel,
        sensor=cause.sensor,
        start=fault.start,
        end=fault.end,
        watched=tuple(t.name for t in description.tests if any(cause.explains(s) for s in t.subjects)),
        explained=tuple(s for s in subjects(description, book) if cause.explains(s)),
    )


def label(fault: Fault, unit: str | None) -> str:
    """What a person calls a fault."""
    size = "" if unit is None else f" {fault.magnitude:g} {unit}"
    return f"{fault.channel} {KINDS[fault.kind].label}{size}"


def faults(
    book: Book,
    description: SystemDescription,
    judge: Judge,
    silent: Mapping[str, str | None],
    period: float,
    runs: Column,
) -> Table:
    """A row per run and fault, by run, then by fault.

    Args:
        silent: fault id -> why it did not act, for those that did not.
        period: seconds between epochs.
        runs: numbers of the runs ``(runs,)``.
    """
    told = [_of_fault(cause, book, description, judge, silent, period, runs) for cause in judge.causes]
    if not told:
        told = [_of_fault(_nobody(book.runs), book, description, judge, silent, period, runs)]
        return table([(name, unit, values[:0]) for name, unit, values in told[0]])
    columns: Described = []
    for several in zip(*told, strict=True):
        name, unit, _ = several[0]
        columns.append((name, unit, np.stack([values for _, _, values in several], axis=-1).ravel()))
    return table(columns)


def _nobody(runs: int) -> Cause:
    """A cause of nothing, for the columns of a table without rows."""
    nowhere = np.full(runs, np.nan)
    return Cause(Fault.model_construct(id="none", channel="", kind="bias", start=0.0), "", None, nowhere, nowhere)


def _of_fault(
    cause: Cause,
    book: Book,
    description: SystemDescription,
    judge: Judge,
    silent: Mapping[str, str | None],
    period: float,
    runs: Column,
) -> Described:
    """Columns ``(runs,)`` of one fault."""
    fault, n = cause.fault, book.runs
    assert fault.start is not None
    because = silent.get(str(fault.id)) or NO_REASON
    columns: Described = [
        ("run", "1", runs),
        ("fault", "1", np.full(n, str(fault.id))),
        ("acted", "1", cause.acted),
        ("first_acted", "s", cause.first),
        ("silent_because", "1", np.where(cause.acted, "", because)),
    ]
    until = cause.last + period
    isolated = judge.history.isolated
    named = {subject: spells for subject, spells in isolated.items() if cause.explains(subject)}
    for test in description.tests:
        explained = [subject for subject in test.subjects if cause.explains(subject)]
        edges = [e for subject in explained if (e := judge.history.alarms.get((test.name, subject))) is not None]
        columns += _seen(
            f"alarm_delay.{test.name}",
            f"alarm_before.{test.name}",
            cause,
            [e.at(cause.first) for e in edges],
            [e.first_between(cause.first, until) for e in edges],
        )
    first = {s: first_between(spells.run, spells.since, cause.first, until) for s, spells in named.items()}
    columns += _seen(
        "isolation_delay",
        "isolated_before",
        cause,
        [spells.at(cause.first) for spells in named.values()],
        list(first.values()),
    )
    at_end, back = _readmitted(cause, named, book)
    columns += [("out_at_end", "1", at_end), ("readmission_delay", "s", back)]
    for subject in subjects(description, book):
        columns.append((f"isolated.{subject}", "1", np.isfinite(first.get(subject, np.full(n, np.nan)))))
    for subject in subjects(description, book):
        columns.append((f"wrong.{subject}", "1", _wronged(subject, cause, judge)))
    end = np.inf if fault.end is None else fault.end
    for signal in description.score_headline:
        values, unit = book.numbers(signal), si_unit(description, signal)
        lo, hi = np.searchsorted(book.time, [fault.start - SLACK, end + SLACK])
        columns.append((f"worst.{signal}", unit, worst(values, slice(int(lo), int(hi)))))
        columns.append((f"worst_since.{signal}", unit, worst(values, since(book, fault.start))))
    return columns


def _seen(delay: str, already: str, cause: Cause, before: list[Flags], times: list[Array]) -> Described:
    """From what was so before the fault acted, and when it became so since, ``(runs,)`` each, of several subjects."""
    runs = len(cause.first)
    was = np.any([np.zeros(runs, bool), *before], axis=0)
    least = np.fmin.reduce([np.full(runs, np.nan), *times])
    return [(delay, "s", np.where(was, np.nan, least - cause.first)), (already, "1", was)]


def _wronged(subject: str, cause: Cause, judge: Judge) -> Flags:
    """Runs ``(runs,)`` in which a subject was isolated wrongly while the fault, or its traces, were there."""
    hit = np.zeros(judge.runs, bool)
    spells = judge.history.isolated.get(subject)
    if spells is not None:
        end = cause.last + judge.recovery
        inside = (spells.since >= cause.first[spells.run] - SLACK) & (spells.since <= end[spells.run] + SLACK)
        hit[spells.run[inside & judge.wrong(subject)]] = True
    return hit


def _readmitted(cause: Cause, named: Mapping[str, Spells], book: Book) -> tuple[Flags, Array]:
    """Runs in which a culprit was out when the fault ended, and how long until it was back [s], ``(runs,)`` each."""
    at_end, back = np.zeros(book.runs, bool), np.full(book.runs, np.nan)
    if cause.fault.end is None or not len(book) or cause.fault.end > book.time[-1] + SLACK:
        return at_end, back
    end = np.where(cause.acted, cause.fault.end, np.nan)
    for spells in named.values():
        over = (spells.since <= end[spells.run] + SLACK) & (spells.until >= end[spells.run] - SLACK)
        at_end[spells.run[over]] = True
        returned = over & spells.readmitted
        delay = spells.until[returned] - end[spells.run[returned]]
        np.fmin.at(back, spells.run[returned], delay)
    return at_end, back
