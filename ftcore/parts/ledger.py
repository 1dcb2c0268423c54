"""The ledger of one epoch: what the parts of a system say, each number under its declared name.

A layout is made once from what a system's parts declare: which column holds which name. In an epoch the parts write by
name; where a name lies is nobody's business. A name with a field in braces is written for all its members at once:
``say["elevation.{satellite}"] = (runs, satellites)``.

A ledger that a navigator writes holds no truth. Errors are added outside, from truth and from the estimates said.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ftcore.parts.declared import OF_TEST, Declared

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Codes = NDArray[np.int8]
Columns = NDArray[np.intp]
Key = TypeVar("Key", bound=Hashable)


class LedgerError(Exception):
    """A part wrote what is not declared, twice, or in another shape; a defect of that part."""


@dataclass(frozen=True)
class Place:
    """Where a declared name lies: ``columns`` of all its members, flat, and how many members each field has."""

    columns: Columns
    shape: tuple[int, ...]


class Layout:
    """Where each name lies: made once from what the parts declare.

    Attributes:
        declared: by all parts.
        signals: of a row, in the order of its columns.
        tests: (test, subject) of every column of tests.
        subjects: name of every column of health and use.
        of_test: part of a test's result -> columns of a row that hold it, in the order of ``tests``.
        blank: ``(signals,)`` a row of which nothing is said yet: no numbers, and tests that have nothing to judge.
    """

    def __init__(self, declared: Declared) -> None:
        self.declared = declared
        self.signals = declared.all_signals()
        self.tests = tuple((test.name, subject) for test in declared.all_tests() for subject in test.subjects)
        self.subjects = declared.names(declared.subjects)
        column = {signal.name: i for i, signal in enumerate(self.signals)}
        self.of_test: Mapping[str, Columns] = {
            part: np.array([column[f"test.{test}.{subject}.{part}"] for test, subject in self.tests], np.intp)
            for part in OF_TEST
        }
        self.blank: Array = np.full(len(self.signals), np.nan)
        self.blank[self.of_test["dof"]] = self.blank[self.of_test["alarm"]] = 0.0

        def place(pattern: str, columns: Iterable[int]) -> Place:
            return Place(np.fromiter(columns, np.intp), declared.shape(pattern))

        self._signals = {
            s.name: place(s.name, (column[name] for name, _ in declared.each(s.name))) for s in declared.signals
        }
        self._tests = {
            (test.name, s): place(s, (self.tests.index((test.name, name)) for name, _ in declared.each(s)))
            for test in declared.tests
            for s in test.subjects
        }
        self._subjects = {
            s: place(s, (self.subjects.index(name) for name, _ in declared.each(s))) for s in declared.subjects
        }
        self._items = {i.id: Place(np.zeros(0, np.intp), (*declared.shape(i.id), 3)) for i in declared.scene}

    def signal(self, name: str) -> Place:
        """Columns of a signal. Raises LedgerError, naming near misses."""
        return _known(self._signals, name, "signal")

    def test(self, test: str, subject: str) -> Place:
        """Columns of a test of a subject, among all tests. Raises LedgerError, naming near misses."""
        return _known(self._tests, (test, subject), "test")

    def subject(self, name: str) -> Place:
        """Columns of a subject, among all subjects. Raises LedgerError, naming near misses."""
        return _known(self._subjects, name, "subject")

    def names_without(self, written: Flags) -> set[str]:
        """Declared names of which no column is among the ``written (signals,)``."""
        tests = {f"test.{test}.{subject}": self.of_test["dof"][p.columns] for (test, subject), p in self._tests.items()}
        signals = {name: place.columns for name, place in self._signals.items()}
        return {name for name, columns in (signals | tests).items() if not written[columns].any()}

    def item(self, id: str) -> Place:
        """Shape of the vectors of a scene item. Raises LedgerError, naming near misses."""
        return _known(self._items, id, "scene item")

    def vectors(self, drawn: Mapping[str, Array]) -> dict[str, Array]:
        """Every scene item -> its vector ``(3,)``, from items or patterns -> vectors of all members.

        Raises:
            LedgerError: it is not declared, or has another shape.
        """
        found: dict[str, Array] = {}
        for pattern, vectors in drawn.items():
            shape = self.item(pattern).shape
            if vectors.shape != shape:
                raise LedgerError(f"{pattern} is drawn as {vectors.shape}; {shape} is declared")
            found |= zip(self.declared.names([pattern]), vectors.reshape(-1, 3), strict=True)
        return found


def _known(where: Mapping[Key, Place], name: Key, what: str) -> Place:
    found = where.get(name)
    if found is None:
        asked, *others = (" of ".join(n) if isinstance(n, tuple) else str(n) for n in (name, *where))
        near = ", ".join(get_close_matches(asked, others, n=3, cutoff=0.0)) or "nothing"
        raise LedgerError(f"no {what} {asked!r} is declared; near it: {near}")
    return found


class Ledger:
    """What is said in one epoch.

    A number that nobody writes is NaN; a test that nobody writes has nothing to judge; a subject that nobody judges is
    healthy and not used. Everything written is ``(runs, ...)`` or, where it is the same for all runs, ``(1, ...)``; the
    axes that follow are the members of the name's fields.

    Attributes:
        row: ``(runs, signals)`` SI.
        written: ``(signals,)`` which were.
        health: ``(runs, subjects)`` codes of :data:`ftcore.systems.base.HEALTH`.
        used: ``(runs, subjects)`` whether the master uses it in this epoch.
        drawn: scene item -> its vector of run 0, or those of its members.
        turned: scene item -> rotation of run 0, body to level ``(3, 3)``.
        values: what errors and pictures are made from, outside: values of the system's own.
    """

    def __init__(self, layout: Layout, runs: int) -> None:
        self.layout = layout
        self.runs = runs
        self.row: Array = np.repeat(layout.blank[None], runs, axis=0)
        self.written: Flags = np.zeros(len(layout.signals), bool)
        self.health: Codes = np.zeros((runs, len(layout.subjects)), np.int8)
        self.used: Flags = np.zeros((runs, len(layout.subjects)), bool)
        self.drawn: dict[str, Array] = {}
        self.turned: dict[str, Array] = {}
        self.values: dict[str, Any] = {}

    # ---- to write

    def __setitem__(self, name: str | tuple[str, Columns], values: Any) -> None:
        """Write a signal, or the members in some ``columns (n,)`` alone: ``say[name, columns] = (runs, n)``.

        Raises:
            LedgerError: it is not declared, is written already, or has another shape.
        """
        if isinstance(name, tuple):
            name, columns = name
            self._put(name, _some(self.layout.signal(name), columns), values)
        else:
            self._put(name, self.layout.signal(name), values)

    def test(
        self,
        test: str,
        subject: str,
        statistic: Any,
        threshold: Any,
        dof: Any,
        alarm: Any,
        columns: Columns | None = None,
    ) -> None:
        """Write a test of a subject, or of the members in some ``columns (n,)``; the others have nothing to judge.

        Raises:
            LedgerError: it is not declared, is written already, or has another shape.
        """
        place = self.layout.test(test, subject)
        if columns is not None:
            place = _some(place, columns)
        for part, values in zip(OF_TEST, (statistic, threshold, dof, alarm), strict=True):
            at = Place(self.layout.of_test[part][place.columns], place.shape)
            self._put(f"test.{test}.{subject}.{part}", at, values)

    def judge(self, subject: str, health: Any, used: Any) -> None:
        """Write health and use of a subject. Raises LedgerError: it is not declared, or has another shape."""
        place = self.layout.subject(subject)
        self.health[:, place.columns] = self._flat(subject, place, health)
        self.used[:, place.columns] = self._flat(subject, place, used)

    def draw(self, item: str, vectors: Array) -> None:
        """Where a scene item of run 0 points ``(3,)``, or all its members ``(members, 3)``; NaN: not to be seen.

        Raises:
            LedgerError: it is not declared, or has another shape.
        """
        self.layout.vectors({item: vectors})
        self.drawn[item] = vectors

    def turn(self, item: str, rotation: Array) -> None:
        """How a scene item of run 0 is turned, body to level ``(3, 3)``. Raises LedgerError: it is not declared."""
        self.layout.item(item)
        self.turned[item] = rotation

    def _put(self, name: str, place: Place, values: Any) -> None:
        flat = self._flat(name, place, values)
        if self.written[place.columns].any():
            raise LedgerError(f"{name} is written twice in one epoch")
        self.written[place.columns] = True
        self.row[:, place.columns] = flat

    def _flat(self, name: str, place: Place, values: Any) -> NDArray[Any]:
        given = np.asarray(values)
        if given.shape[1:] != place.shape or given.shape[:1] not in ((1,), (self.runs,)):
            shape = ", ".join(map(str, (f"{self.runs} or 1", *place.shape)))
            raise LedgerError(f"{name} is written as {given.shape}; ({shape}) is declared")
        return given.reshape(len(given), len(place.columns))

    # ---- to read

    def __getitem__(self, name: str) -> Array:
        """A signal ``(runs,)``, or those of all members ``(runs, members, ...)``. Raises LedgerError."""
        place = self.layout.signal(name)
        return self.row[:, place.columns].reshape(self.runs, *place.shape)

    def of_test(self, test: str, subject: str, part: str) -> Array:
        """A part of a test's result ``(runs,)``, or of all members of its subject. Raises LedgerError."""
        place = self.layout.test(test, subject)
        return self.row[:, self.layout.of_test[part][place.columns]].reshape(self.runs, *place.shape)

    def alarms(self) -> list[tuple[str, str]]:
        """(test, subject) of every alarm in run 0."""
        alarm = self.row[0, self.layout.of_test["alarm"]] > 0.0
        return [pair for pair, raised in zip(self.layout.tests, alarm.tolist(), strict=True) if raised]

    def is_used(self, subject: str) -> bool:
        """Whether the master uses a subject, by its own name, in run 0."""
        return bool(self.used[0, self.layout.subjects.index(subject)])

    def unsaid(self) -> set[str]:
        """Declared names, and tests as ``test.<test>.<subject>``, of which nothing was written."""
        return self.layout.names_without(self.written)

    def copy(self) -> Ledger:
        """Another one that says the same so far and can be written on."""
        other = copy(self)
        other.row, other.written = self.row.copy(), self.written.copy()
        other.drawn, other.turned, other.values = dict(self.drawn), dict(self.turned), dict(self.values)
        return other


def _some(place: Place, columns: Columns) -> Place:
    return Place(place.columns[columns], (len(columns),))
