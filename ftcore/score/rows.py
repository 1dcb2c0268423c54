"""Rows of a score: a row per run, a row per run and fault, a row per wrong isolation.

Everything a score shows is computed from them (:func:`ftcore.score.summary.summarise`), so the scores of some runs and
of others merge to the score of all. Columns, with their units, SI:

``flights``, one row per run, ordered by run:

==================================================  =========================================================
``run``                                             number of the run
``tests.<test>.<subject>``, ``alarms....``          tests of a sound subject, and false alarms among them
``stretches....``                                   unbroken stretches of these alarms
``reached_tests....``, ``reached_alarms....``       the same while another fault entered the test
``isolations.<subject>``                            isolations of the subject, right or wrong
``wrong_isolations....``, ``calm_isolations....``   the wrong ones, and those of them when nothing at all was wrong
``in_use.<subject>``                                seconds in use with nothing wrong about it
``squares.<estimator>.<quantity>``                  sum of squared errors since the filters settled
``worst_square....``, ``epochs....``                largest of them, and how many there are
``nees.<estimator>``, ``nees_epochs.<estimator>``   sum of normalised errors squared, and how many
``worst.<signal>``                                  largest absolute value of a headline signal since settling
==================================================  =========================================================

``faults``, one row per run and fault, ordered by run, then by fault:

==================================================  =========================================================
``run``, ``fault``                                  number of the run, id of the fault
``acted``, ``first_acted``                          whether and when it first changed a reading
``silent_because``                                  why it did not, as its flight says it of its first run
``alarm_delay.<test>``                              from then to the alarm; NaN where there was none
``alarm_before.<test>``                             in alarm already
``isolation_delay``, ``isolated_before``            the same of the culprit's isolation
``isolated.<subject>``                              the culprit, by this name, was isolated while it acted
``wrong.<subject>``                                 a sound subject was isolated while it, or its traces, were there
``out_at_end``, ``readmission_delay``               isolated when the fault ended, and how long until it was back
``worst.<signal>``, ``worst_since.<signal>``        largest absolute value from its start to its end, and to now
==================================================  =========================================================

``wrong``, one row per wrong isolation, ordered by time, then by run: ``run``, ``subject``, ``time``, ``calm``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftcore.description import SystemDescription
from ftcore.display import counted
from ftcore.scenario import Scenario
from ftcore.score.tables import Column, Table, stacked


@dataclass(frozen=True)
class FaultFacts:
    """What is the same of a fault in every run.

    Attributes:
        watched: tests that look at a subject which the fault explains.
        explained: subjects that it is right to blame.
    """

    id: str
    label: str
    channel: str
    sensor: str
    start: float
    end: float | None
    watched: tuple[str, ...]
    explained: tuple[str, ...]


@dataclass(frozen=True)
class Rows:
    """The rows of a score; a value.

    Attributes:
        description: of the system.
        time: of the last epoch [s].
        facts: of the faults, in the order in which they were laid.
        flights, faults, wrong: see above.
        document: what was flown, commands included, without the runs; None where that is not known.
    """

    description: SystemDescription
    time: float
    facts: tuple[FaultFacts, ...]
    flights: Table
    faults: Table
    wrong: Table
    document: Scenario | None = None

    @property
    def runs(self) -> NDArray[np.int64]:
        """Numbers of the runs ``(runs,)``, rising."""
        runs: NDArray[np.int64] = self.flights["run"]
        return runs

    def __repr__(self) -> str:
        """How many rows of what."""
        return (
            f"<Rows of {counted(len(self.runs), 'run')}, {self.time:g} s: flights {len(self.flights)}, "
            f"faults {len(self.faults)} ({', '.join(facts.id for facts in self.facts) or 'none'}), "
            f"wrong isolations {len(self.wrong)}>"
        )

    def of_fault(self, fault: str) -> Table:
        """The rows of one fault, one per run. Raises KeyError if there is no such fault."""
        ids = [facts.id for facts in self.facts]
        if fault not in ids:
            raise KeyError(f"no fault {fault!r}; there are {', '.join(ids) or 'none'}")
        return self.faults.take(slice_of(ids.index(fault), len(ids)))

    def of_runs(self, runs: Iterable[int]) -> Rows:
        """The rows of some of the runs, by number. Raises KeyError for a run that is not there."""
        wanted = np.array(sorted(set(runs)), dtype=np.int64)
        if len(absent := np.setdiff1d(wanted, self.runs)):
            raise KeyError(f"no run {absent[0]}; there are {len(self.runs)}, {self.runs[0]} to {self.runs[-1]}")
        flights, faults, wrong = (
            table.take(np.isin(table["run"], wanted)) for table in (self.flights, self.faults, self.wrong)
        )
        return replace(self, flights=flights, faults=faults, wrong=wrong)


def slice_of(i: int, faults: int) -> slice:
    """Where the rows of fault ``i`` of so many are, in rows ordered by run, then by fault."""
    return slice(i, None, faults)


def merged(parts: Sequence[Rows]) -> Rows:
    """Rows of several sets of runs as those of all of them, to the bit.

    Raises:
        ValueError: nothing to merge, a run that is in two of them, or flights that are not the same but for the run.
    """
    if not parts:
        raise ValueError("there are no scores to merge")
    first = parts[0]
    for other in parts[1:]:
        _same_flight(first, other)
    numbers = np.concatenate([part.runs for part in parts])
    values, counts = np.unique(numbers, return_counts=True)
    if (counts > 1).any():
        raise ValueError(f"run {values[counts > 1][0]} is in two of the scores; each run counts once")
    flights, faults, wrong = (
        stacked([getattr(part, name) for part in parts]) for name in ("flights", "faults", "wrong")
    )
    lowest = min(parts, key=lambda part: part.runs[0])
    return replace(
        lowest,
        flights=flights.take(np.argsort(flights["run"], kind="stable")),
        faults=faults.take(np.argsort(faults["run"], kind="stable")),
        wrong=wrong.take(in_order(wrong["time"], wrong["run"])),
    )


def in_order(time: Column, run: Column) -> Column:
    """Order of wrong isolations: by time, then by run; of one time and run as they are."""
    order: Column = np.lexsort((run, time))
    return order


def _same_flight(a: Rows, b: Rows) -> None:
    """Refuse to merge flights that differ in more than the run. Raises ValueError."""
    if a.description.id != b.description.id or a.description != b.description:
        raise ValueError(f"the scores are of two systems, {a.description.id} and {b.description.id}")
    if a.time != b.time:
        raise ValueError(f"the scores are of {a.time:g} s and of {b.time:g} s; fly both as far")
    if a.facts != b.facts:
        raise ValueError("the scores are of flights with other faults")
    if a.document != b.document:
        raise ValueError("the scores are of two scenarios, seeds or sequences of commands")
