"""Events as arrays: who was isolated from when to when, and which test alarmed, in which run.

Events are complete where a bounded recording is not, so what happened *when* is read from them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.events import Event

Array = NDArray[np.float64]
Runs = NDArray[np.intp]
Flags = NDArray[np.bool_]

NEVER = np.inf
SLACK = 1e-9
"""Seconds by which two equal times may differ as floating-point numbers."""


@dataclass(frozen=True)
class Spells:
    """When one subject was isolated: ``(n,)`` each, in order of the beginnings; ``until`` is infinite while it is."""

    run: Runs
    since: Array
    until: Array
    readmitted: Flags

    @classmethod
    def none(cls) -> Spells:
        """Of a subject that never was."""
        return cls(np.empty(0, np.intp), np.empty(0), np.empty(0), np.empty(0, bool))

    def at(self, moment: Array) -> Flags:
        """Whether the subject was isolated just before ``moment (runs,)``; False where that is NaN."""
        out = np.zeros(len(moment), bool)
        then = moment[self.run]
        out[self.run[(self.since < then - SLACK) & (self.until >= then - SLACK)]] = True
        return out

    def end_of(self, moment: Array) -> Array:
        """When the spell ended that lasted beyond ``moment (runs,)``; ``moment`` itself where there was none."""
        end = np.array(moment)
        then = moment[self.run]
        over = (self.since <= then + SLACK) & (self.until > then + SLACK)
        np.maximum.at(end, self.run[over], self.until[over])
        return end


@dataclass(frozen=True)
class Edges:
    """Where the alarm of one test on one subject rose and fell: ``(n,)`` each, in order of time."""

    run: Runs
    time: Array
    rose: Flags

    def at(self, moment: Array) -> Flags:
        """Whether it was in alarm just before ``moment (runs,)``; False where that is NaN."""
        state = np.zeros(len(moment), bool)
        before = self.time < moment[self.run] - SLACK
        # Of several edges of one run the last one stays, as numpy assigns in order.
        state[self.run[before]] = self.rose[before]
        return state

    def first_between(self, start: Array, end: Array) -> Array:
        """Time of the first rise from ``start`` to ``end``, ``(runs,)``; NaN where there is none."""
        return first_between(self.run[self.rose], self.time[self.rose], start, end)


@dataclass(frozen=True)
class History:
    """What happened: subject -> spells of isolation, (test, subject) -> edges of its alarm."""

    isolated: dict[str, Spells]
    alarms: dict[tuple[str, str], Edges]


def first_between(run: Runs, time: Array, start: Array, end: Array) -> Array:
    """Time of the first of some moments ``(n,)`` from ``start`` to ``end (runs,)``; NaN in runs that have none."""
    first = np.full(len(start), np.inf)
    inside = (time >= start[run] - SLACK) & (time <= end[run] + SLACK)
    np.minimum.at(first, run[inside], time[inside])
    return np.where(np.isfinite(first), first, np.nan)


def read(events: Sequence[Event], first_run: int = 0) -> History:
    """Events as arrays.

    Args:
        events: in order of time; ``run`` counts from ``first_run``, and is -1 for what the operator did.
        first_run: index of the first run of this flight.
    """
    alarms: dict[tuple[str, str], list[tuple[int, float, bool]]] = defaultdict(list)
    spells: dict[str, list[tuple[int, float, float, bool]]] = defaultdict(list)
    opened: dict[tuple[str, int], float] = {}

    def close(subject: str, run: int, time: float, readmitted: bool) -> None:
        since = opened.pop((subject, run), None)
        if since is not None:
            spells[subject].append((run, since, time, readmitted))

    for event in events:
        kind, subject, run = event.kind, event.subject, event.run - first_run
        if kind in ("test.alarmed", "test.cleared"):
            alarms[event.detail["test"], subject].append((run, event.time, kind == "test.alarmed"))
        elif kind == "subsystem.isolated":
            opened.setdefault((subject, run), event.time)
        elif kind in ("subsystem.readmitted", "subsystem.suspected"):
            close(subject, run, event.time, kind == "subsystem.readmitted")
        elif kind == "subsystem.switched" and not event.detail.get("enabled", True):
            below = [key for key in opened if key[0] == subject or key[0].startswith(subject + ".")]
            for name, isolated_run in below:
                close(name, isolated_run, event.time, False)
    for name, isolated_run in list(opened):
        close(name, isolated_run, NEVER, False)
    return History(
        {name: _spells(rows) for name, rows in spells.items()},
        {key: _edges(rows) for key, rows in alarms.items()},
    )


def _spells(rows: Iterable[tuple[int, float, float, bool]]) -> Spells:
    run, since, until, readmitted = zip(*sorted(rows, key=lambda row: row[1]), strict=True)
    return Spells(np.array(run, np.intp), np.array(since), np.array(until), np.array(readmitted, bool))


def _edges(rows: Sequence[tuple[int, float, bool]]) -> Edges:
    run, time, rose = zip(*rows, strict=True)
    return Edges(np.array(run, np.intp), np.array(time), np.array(rose, bool))
