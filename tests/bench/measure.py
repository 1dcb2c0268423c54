"""How the bench measures: processor time of this process, one BLAS thread, the least of several tries.

The machine may be shared. Processor time does not count what others use; the least of several tries drops what others
cost all the same, by caches and by clock rate. What is compared is measured turn by turn in one process.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pytest

Call = Callable[[], Any]


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

    @property
    def met(self) -> bool | None:
        """Whether the target is reached; None where there is none."""
        if self.target is None:
            return None
        return self.value >= self.target if self.sense == "least" else self.value <= self.target


def seconds(call: Call) -> float:
    """Processor time of one call [s]."""
    start = time.process_time()
    call()
    return time.process_time() - start


def least(calls: Sequence[Call], tries: int) -> list[float]:
    """The least processor time of each call [s], the calls taking turns."""
    taken = [[seconds(call) for call in calls] for _ in range(tries)]
    return [min(column) for column in zip(*taken, strict=True)]


def reached(met: bool, said: str) -> None:
    """Fail where a figure was not reached; skip, with what was measured, where others keep the machine busy meanwhile.

    Hyper-threads and caches are shared, so even processor time grows by half beside a neighbour.
    """
    print(said)
    if met:
        return
    if busy_share() > 0.5:
        pytest.skip(f"others keep this machine busy; {said}")
    raise AssertionError(said)


def busy_share(seconds: float = 1.0) -> float:
    """How much of this machine others are using while this process sleeps; 0 where it cannot be told."""

    def ticks() -> tuple[int, int]:
        numbers = [int(text) for text in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:]]
        return sum(numbers) - numbers[3] - numbers[4], sum(numbers)

    if not Path("/proc/stat").exists():
        return 0.0
    (busy, whole), _, (later, whole_later) = ticks(), time.sleep(seconds), ticks()
    return (later - busy) / max(1, whole_later - whole)
