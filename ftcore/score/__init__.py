"""Score: a flight against the truth, judged in time.

Per fault: when which test noticed, when the culprit was named, who was wronged meanwhile, when it was trusted again,
what it cost. Per test: alarms while nothing was wrong with its subject. Per subject: isolations of the sound. Per
estimator: errors and consistency. What concerns whom, and until when after a fault, is written once, in
:mod:`ftcore.score.blame`.

Delays are medians over the runs in which it happened, and count from the first epoch in which the fault acted; shares
are of the runs in which it acted. A fault that never acted is listed with the reason, and is neither found nor missed.
Every share and rate has its exact 95 % interval. Those of false alarms take tests as independent; where alarms come in
clusters it is said, and the share of runs with an alarm, which are independent, stands beside.

All of it is computed from rows, one per run and one per run and fault (:mod:`ftcore.score.rows`), so that the scores of
some runs and of others merge to the score of all (:func:`merge`). The rows come from a book that is kept while the
flight flies (:mod:`ftcore.score.book`), so a score does not depend on which signals are recorded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ftcore.description import SystemDescription
from ftcore.events import Event
from ftcore.faults import Acted, ChannelAddress, Fault
from ftcore.scenario import Scenario
from ftcore.score.blame import judge
from ftcore.score.book import Book
from ftcore.score.fault_rows import facts_of
from ftcore.score.fault_rows import faults as told
from ftcore.score.flight_rows import flights, wrong
from ftcore.score.healthy import of_alarms
from ftcore.score.history import read
from ftcore.score.models import (
    ErrorScore,
    EstimatorScore,
    FaultScore,
    Headline,
    IsolationScore,
    Outcome,
    Score,
    Share,
    TestScore,
    WrongIsolation,
)
from ftcore.score.rows import FaultFacts, Rows
from ftcore.score.summary import merge, summarise
from ftcore.score.tables import Table

__all__ = [
    "Book",
    "ErrorScore",
    "EstimatorScore",
    "FaultFacts",
    "FaultScore",
    "Headline",
    "IsolationScore",
    "Outcome",
    "Rows",
    "Score",
    "Share",
    "Table",
    "TestScore",
    "WrongIsolation",
    "compute",
    "merge",
    "of_alarms",
    "summarise",
]


def compute(
    book: Book,
    events: Sequence[Event],
    faults: Sequence[Fault],
    description: SystemDescription,
    channels: Mapping[str, ChannelAddress],
    acted: Mapping[str, Acted],
    silent: Mapping[str, str | None] | None = None,
    first_run: int = 0,
    period: float | None = None,
    document: Scenario | None = None,
) -> Score:
    """Score a flight. Pure; needs nothing of the system but its description.

    Args:
        book: of the flight so far.
        events: all of it, in order of time.
        faults: all that were laid; those that start later are not told.
        description: of the system.
        channels: addresses by channel name.
        acted: fault id -> when it acted in each run; one that is missing has never acted.
        silent: fault id -> why it did not act, for those that did not.
        first_run: number of the first run, by which events name it.
        period: seconds between epochs; the system's if absent.
        document: what was flown, to tell scores that can be merged; see :func:`merge`.
    """
    now = float(book.time[-1]) if len(book) else 0.0
    begun = [f for f in faults if f.start is not None and f.start <= now]
    judged = judge(begun, acted, channels, description, read(events, first_run), book.runs)
    numbers = flights(book, description, judged, first_run)
    rows = Rows(
        description,
        now,
        tuple(facts_of(cause, description, channels, book) for cause in judged.causes),
        numbers,
        told(book, description, judged, silent or {}, period or description.epoch, numbers["run"]),
        wrong(description, book, judged, first_run),
        document,
    )
    return summarise(rows)
