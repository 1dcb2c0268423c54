"""The row of each run: what happened to the sound, and how large the errors were.

Counted over the whole flight, whenever nothing that concerns the subject is there (:mod:`ftcore.score.blame`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftcore import units
from ftcore.description import SystemDescription
from ftcore.score.blame import Judge
from ftcore.score.book import QUANTITIES, Book
from ftcore.score.history import Spells
from ftcore.score.rows import in_order
from ftcore.score.tables import Column, Table

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Described = list[tuple[str, str, Column]]
"""Name, unit and values of columns."""

SETTLING = 20.0
"""Seconds at the start that do not count as errors: the filters are still converging."""
SI = {"position": "m", "velocity": "m/s", "attitude": "rad"}


def flights(book: Book, description: SystemDescription, judge: Judge, first_run: int) -> Table:
    """A row per run."""
    columns: Described = [("run", "1", np.arange(first_run, first_run + book.runs, dtype=np.int64))]
    for test, subject in book.tests:
        columns += _alarms(test, subject, book, judge)
    for subject in subjects(description, book):
        columns += _isolations(subject, book, judge)
    settled = since(book, SETTLING)
    for estimator in description.estimators:
        columns += _errors(estimator, book, settled)
    for signal in description.score_headline:
        columns.append((f"worst.{signal}", si_unit(description, signal), worst(book.numbers(signal), settled)))
    return table(columns)


def wrong(description: SystemDescription, book: Book, judge: Judge, first_run: int) -> Table:
    """A row per wrong isolation."""
    run: list[Column] = [np.empty(0, np.int64)]
    who: list[Column] = [np.empty(0, "<U1")]
    time: list[Column] = [np.empty(0)]
    calm: list[Column] = [np.empty(0, bool)]
    for subject in subjects(description, book):
        spells = judge.history.isolated.get(subject, Spells.none())
        hit = judge.wrong(subject)
        run.append(spells.run[hit].astype(np.int64) + first_run)
        who.append(np.full(int(hit.sum()), subject))
        time.append(spells.since[hit])
        calm.append(judge.calm(subject)[hit])
    columns = [np.concatenate(parts) for parts in (run, who, time, calm)]
    order = in_order(columns[2], columns[0])
    names = (("run", "1"), ("subject", "1"), ("time", "s"), ("calm", "1"))
    return table([(name, unit, values[order]) for (name, unit), values in zip(names, columns, strict=True)])


def table(columns: Described) -> Table:
    """A table from described columns."""
    return Table(
        {name: np.ascontiguousarray(values) for name, _, values in columns}, {name: unit for name, unit, _ in columns}
    )


def subjects(description: SystemDescription, book: Book) -> list[str]:
    """Whoever can be isolated: who is used, can be switched, or is tested."""
    tested = [subject for test in description.tests for subject in test.subjects]
    return list(dict.fromkeys([*book.used, *(s.name for s in description.subsystems if s.isolable), *tested]))


def si_unit(description: SystemDescription, signal: str) -> str:
    """Unit in which a signal is recorded."""
    return next(units.si(s.unit) for s in description.signals if s.name == signal)


def since(book: Book, start: float, end: float = np.inf) -> slice:
    """Epochs from ``start`` to ``end`` [s]; all of them while none is as late as the start."""
    lo, hi = (int(i) for i in np.searchsorted(book.time, [start - 1e-9, end + 1e-9]))
    return slice(lo, hi) if lo < len(book) else slice(0, None)


def worst(values: Array | None, epochs: slice) -> Array:
    """Largest absolute value in each run ``(runs,)`` of ``values (epochs, runs)``; NaN where there is no number."""
    assert values is not None
    picked = np.abs(values[epochs])
    nothing = np.full(values.shape[1], np.nan)
    return nothing if not len(picked) else np.asarray(np.fmax.reduce(picked, axis=0))


def total(values: Array) -> Array:
    """Sum over the epochs in their order, ``(runs,)``, so that it does not depend on how many runs there are."""
    if not len(values):
        return np.zeros(values.shape[1])
    return np.asarray(np.cumsum(values, axis=0)[-1])


def _alarms(test: str, subject: str, book: Book, judge: Judge) -> Described:
    tested, alarm = book.tested(test, subject), book.alarm(test, subject)
    own, reaching = judge.explaining(subject), judge.reaching(test, subject)
    reached = np.zeros_like(tested)
    sound = tested
    if own or reaching:
        ours = judge.there(own, subject, book.time)
        others = judge.there(reaching, subject, book.time)
        sound, reached = tested & ~ours & ~others, tested & ~ours & others
    false = alarm & sound
    begins = false.copy()
    begins[1:] &= ~false[:-1]
    counts = {
        "tests": sound,
        "alarms": false,
        "stretches": begins,
        "reached_tests": reached,
        "reached_alarms": alarm & reached,
    }
    return [(f"{what}.{test}.{subject}", "1", where.sum(axis=0, dtype=np.int64)) for what, where in counts.items()]


def _isolations(subject: str, book: Book, judge: Judge) -> Described:
    exposed = book.in_use(subject)
    own = judge.explaining(subject)
    if own:
        exposed = exposed & ~judge.there(own, subject, book.time)
    spells = judge.history.isolated.get(subject, Spells.none())
    wrongly, calm = judge.wrong(subject), judge.calm(subject)

    def counted(which: Flags) -> Column:
        return np.bincount(spells.run[which], minlength=book.runs).astype(np.int64)

    # A recorded epoch stands for more than one period where a bounded recording was thinned.
    lasting = np.diff(book.time, prepend=0.0)
    return [
        (f"isolations.{subject}", "1", counted(np.ones(len(spells.run), bool))),
        (f"wrong_isolations.{subject}", "1", counted(wrongly)),
        (f"calm_isolations.{subject}", "1", counted(wrongly & calm)),
        (f"in_use.{subject}", "s", total(exposed * lasting[:, None])),
    ]


def _errors(estimator: str, book: Book, settled: slice) -> Described:
    columns: Described = []
    for quantity in QUANTITIES:
        squared = book.numbers(f"{estimator}.{quantity}")
        if squared is None:
            continue
        picked, name = squared[settled], f"{estimator}.{quantity}"
        there = ~np.isnan(picked)
        columns += [
            (f"squares.{name}", f"({SI[quantity]})^2", total(np.where(there, picked, 0.0))),
            (f"worst_square.{name}", f"({SI[quantity]})^2", worst(squared, settled)),
            (f"epochs.{name}", "1", there.sum(axis=0, dtype=np.int64)),
        ]
    nees = book.numbers(f"{estimator}.nees")
    if nees is not None:
        picked = nees[settled]
        there = ~np.isnan(picked)
        columns += [
            (f"nees.{estimator}", "1", total(np.where(there, picked, 0.0))),
            (f"nees_epochs.{estimator}", "1", there.sum(axis=0, dtype=np.int64)),
        ]
    return columns
