"""How the bench measures: processor time of this process, one BLAS thread, the least of several tries.

The machine may be shared. Processor time does not count what others use; the least of several tries drops what others
cost all the same, by caches and by clock rate. What is compared is measured turn by turn in one process.

A ratio of two such figures holds on any machine. A target in seconds was set on one, so it is asked at that machine's
pace: a yardstick, work of numpy's and none of ours, is timed between the pieces of what is measured, and the seconds
are divided by how many times slower it was than there. Where it is as fast as there, or faster, the seconds stand.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

Call = Callable[[], Any]
Pieces = Iterator[Any]
"""Something to be measured, in pieces between which others may be: one each time it is asked for the next."""

REFERENCE_CALL, REFERENCE_RATE = 2.5e-6, 25e9
"""What the reference machine does, on which the targets in seconds were set: seconds of a call of numpy's product of
two ``(1, 21, 21)`` arrays, and floating-point operations a second in a product of many. Both are from the design notes
(the architecture, "Batch first"), which have nothing else about it that is to be had between two epochs."""
CALLS, BATCH = 6, 20
"""Half of a yardstick's time on the reference machine is calls and half is arithmetic."""
REFERENCE = CALLS * REFERENCE_CALL + 2.0 * BATCH * 21**3 / REFERENCE_RATE
"""Seconds of :func:`yardstick` on the reference machine."""
SURROUNDED = 1.1
"""A yardstick between epochs takes so much longer than by itself, wherever it is: they leave the caches full of their
things. Measured: 1.07 to 1.12, one run and 100 of three systems. Without it every figure would look better by that."""
TRIES = 8
"""Pieces of work that a yardstick is the least of: the first two or three find the caches cold."""
TURN = 0.005
"""Processor seconds [s] after which the yardstick has its turn; the speed of a shared machine lasts for some 0.02 s."""

_ONE = np.random.default_rng(21).standard_normal((1, 21, 21))
_MANY = np.random.default_rng(21).standard_normal((BATCH, 21, 21))
_END = object()


@dataclass(frozen=True)
class Figure:
    """One line of the table."""

    subject: str
    name: str
    value: float
    unit: str
    target: float | None = None
    sense: Literal["least", "most"] = "least"
    note: str = ""
    at_reference: float | None = None
    """The value at the reference machine's pace; None where it depends on no machine."""

    @property
    def met(self) -> bool | None:
        """Whether the target is reached, at the reference machine's pace; None where there is none."""
        if self.target is None:
            return None
        judged = self.value if self.at_reference is None else self.at_reference
        return judged >= self.target if self.sense == "least" else judged <= self.target


@dataclass(frozen=True)
class Taken:
    """Processor seconds of one try, and how many times slower than the reference machine this one was meanwhile."""

    seconds: float
    pace: float

    @property
    def at_reference(self) -> float:
        """Seconds at the reference machine's pace; never more than were taken, and no less where it is as fast."""
        return self.seconds / max(1.0, self.pace)

    def __str__(self) -> str:
        return f"{self.seconds:.3g} s, {self.at_reference:.3g} s at the reference pace (pace {self.pace:.2f})"


def seconds(call: Call) -> float:
    """Processor time of one call [s]."""
    start = time.process_time()
    call()
    return time.process_time() - start


def least(calls: Sequence[Call], tries: int) -> list[float]:
    """The least processor time of each call [s], the calls taking turns."""
    taken = [[seconds(call) for call in calls] for _ in range(tries)]
    return [min(column) for column in zip(*taken, strict=True)]


def calls() -> None:
    """What one run is made of: calls of numpy on small arrays, most of which is the interpreter's work."""
    for _ in range(CALLS):
        _ONE @ _ONE


def arithmetic() -> None:
    """What many runs are made of: numbers."""
    _MANY @ _MANY


def yardstick() -> float:
    """Processor seconds of :func:`calls` and :func:`arithmetic` here and now."""

    def both() -> None:
        calls()
        arithmetic()

    return min(seconds(both) for _ in range(TRIES))


def call_and_rate() -> tuple[float, float]:
    """Seconds of a call and operations a second here and now, to lay beside :data:`REFERENCE_CALL` and
    :data:`REFERENCE_RATE`."""
    call, batch = (min(seconds(what) for _ in range(100)) for what in (calls, arithmetic))
    return call / CALLS, 2.0 * BATCH * 21**3 / batch


def pace(over: float = 0.1) -> float:
    """How many times slower than the reference machine this one is, on average over so many seconds from now."""
    measured, end = [yardstick()], time.perf_counter() + over
    while time.perf_counter() < end:
        measured.append(yardstick())
    return sum(measured) / len(measured) / REFERENCE


def once(call: Call) -> Pieces:
    """What cannot be taken to pieces."""
    yield call()


def taken(pieces: Pieces) -> Taken:
    """Processor time of all pieces. The yardstick has its turn before, in between and after: each stretch is divided by
    the mean of those at its two ends."""
    whole = at_reference = stretch = 0.0
    before, ended = yardstick(), False
    while not ended:
        start = time.process_time()
        ended = next(pieces, _END) is _END
        stretch += time.process_time() - start
        if stretch >= TURN or ended:
            after = yardstick()
            whole += stretch
            at_reference += stretch * 2.0 * SURROUNDED * REFERENCE / (before + after)
            before, stretch = after, 0.0
    return Taken(whole, whole / at_reference)


def best(make: Callable[[], Pieces], tries: int) -> Taken:
    """The try that took least, and the pace while it was taken.

    Chosen by what it took, not by what it would take at the reference pace: a disturbed yardstick favours nobody.
    """
    return min((taken(make()) for _ in range(tries)), key=lambda t: t.seconds)


def percentile(values: Sequence[float], share: float) -> float:
    """The value that ``share`` of all are below."""
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]
