"""Which fault explains what, and when: the one place where a score decides whether somebody was wronged.

A fault *explains* a subject that is the sensor of its channel, a part or the whole of it. A satellite's fault explains
that satellite and the receiver, not another satellite; a gyro's fault that gyro and the cluster of gyros. Nothing else:
an aid that is isolated because the inertial sensors failed is isolated wrongly, for it was sound.

A fault *reaches* the test of a subject that it does not explain where it enters the same equations: that of a sibling,
which shares the parity equations with the faulty instrument or satellite, and that of a subject which is tested
against the faulty sensor (:attr:`ftcore.description.Test.reference`). What such a test says is no false alarm, for the
test is right that something disagrees; to isolate the subject for it is wrong all the same.

A fault counts as there, in each run, while it acts, and for ``recovery`` seconds more: its traces are still in filters
and windows then. Where the subject is isolated when the fault last acts, the seconds count from its re-admission. A
fault that pauses for longer than that, its satellite set or its sensor switched off, is not there until it acts again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.description import SystemDescription
from ftcore.faults import Acted, ChannelAddress, Fault
from ftcore.score.history import SLACK, History, Runs, Spells

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Cause:
    """One fault as a cause.

    Attributes:
        sensor: of its channel.
        part: the single part of the sensor that the channel is, as a subject; None where the channel is all of it.
        first, last: ``(runs,)`` first and last epoch in which it acted [s]; NaN where it never did.
        pauses: see :class:`ftcore.faults.Acted`.
    """

    fault: Fault
    sensor: str
    part: str | None
    first: Array
    last: Array
    pauses: tuple[tuple[Array, Array], ...] = ()

    @property
    def acted(self) -> Flags:
        """Runs in which it acted."""
        return np.isfinite(self.first)

    def spells(self, bridged: float) -> list[tuple[Array, Array]]:
        """From when to when it acted, ``(runs,)`` each, pauses of up to ``bridged`` seconds included; NaN: no more."""
        found, start = [], self.first
        for before, after in self.pauses:
            cut = after - before > bridged
            if cut.any():
                found.append((np.where(cut, start, np.nan), np.where(cut, before, np.nan)))
                start = np.where(cut, after, start)
        return [*found, (start, self.last)]

    def explains(self, subject: str) -> bool:
        """Whether it is right to blame ``subject`` for this fault."""
        if within(self.sensor, subject):
            return True
        if self.part is None:
            return within(subject, self.sensor)
        return within(self.part, subject) or within(subject, self.part)

    def reaches(self, subject: str, reference: Sequence[str], subjects: frozenset[str]) -> bool:
        """Whether it enters the test of a ``subject`` that it does not explain.

        Args:
            subject: what the test is about.
            reference: what the test compares it with.
            subjects: all that are ever tested, by which siblings are known: parts of one of them.
        """
        if self.explains(subject):
            return False
        whole = subject.rpartition(".")[0]
        return (whole in subjects and within(self.sensor, whole)) or any(within(self.sensor, r) for r in reference)


def within(name: str, whole: str) -> bool:
    """Whether ``name`` is ``whole`` or a part of it: ``gps.C1`` of ``gps``."""
    return name == whole or name.startswith(whole + ".")


def cause(fault: Fault, channel: ChannelAddress, acted: Acted | None, runs: int) -> Cause:
    """A fault as a cause; it never acted where nothing is known of that."""
    if acted is None:
        acted = Acted.never(runs)
    part = f"{channel.sensor}.{channel.name.rpartition('.')[2]}" if len(channel.parts) == 1 else None
    return Cause(fault, channel.sensor, part, acted.first, acted.last, acted.pauses)


@dataclass(frozen=True)
class Judge:
    """Says of a moment whether anything that concerns a subject was wrong, or had been recently."""

    causes: tuple[Cause, ...]
    history: History
    recovery: float
    runs: int
    references: Mapping[str, tuple[str, ...]]
    subjects: frozenset[str]

    def windows(self, source: Cause, subject: str) -> list[tuple[Array, Array]]:
        """From when to when, ``(runs,)`` each, a fault counts as there for a subject, recovery included."""
        isolated = self.history.isolated.get(subject, Spells.none())
        return [
            (start - SLACK, isolated.end_of(end) + self.recovery + SLACK) for start, end in source.spells(self.recovery)
        ]

    def explaining(self, subject: str) -> list[Cause]:
        """Faults that explain a subject."""
        return [source for source in self.causes if source.explains(subject)]

    def reaching(self, test: str, subject: str) -> list[Cause]:
        """Faults that enter the test of a subject without explaining it."""
        reference = self.references.get(test, ())
        return [source for source in self.causes if source.reaches(subject, reference, self.subjects)]

    def there(self, sources: Iterable[Cause], subject: str, time: Array) -> Flags:
        """Whether any of the faults counts as there, for a subject at each of ``time (n,)``: ``(n, runs)``."""
        there = np.zeros((len(time), self.runs), bool)
        for source in sources:
            for start, end in self.windows(source, subject):
                there |= (time[:, None] >= start) & (time[:, None] <= end)
        return there

    def wrong(self, subject: str) -> Flags:
        """Which spells of a subject's isolation ``(n,)`` began when nothing that explains it was there."""
        spells = self.history.isolated.get(subject, Spells.none())
        return ~self._at(self.explaining(subject), subject, spells.run, spells.since)

    def calm(self, subject: str) -> Flags:
        """Which spells ``(n,)`` began when no fault at all was there."""
        spells = self.history.isolated.get(subject, Spells.none())
        return ~self._at(self.causes, subject, spells.run, spells.since)

    def _at(self, sources: Iterable[Cause], subject: str, run: Runs, time: Array) -> Flags:
        there = np.zeros(len(time), bool)
        for source in sources:
            for start, end in self.windows(source, subject):
                there |= (time >= start[run]) & (time <= end[run])
        return there


def judge(
    faults: Iterable[Fault],
    acted: Mapping[str, Acted],
    channels: Mapping[str, ChannelAddress],
    description: SystemDescription,
    history: History,
    runs: int,
) -> Judge:
    """A judge of one flight."""
    tested = {subject for test in description.tests for subject in test.subjects}
    return Judge(
        tuple(cause(fault, channels[fault.channel], acted.get(str(fault.id)), runs) for fault in faults),
        history,
        description.recovery,
        runs,
        {test.name: test.reference for test in description.tests},
        frozenset(tested),
    )
