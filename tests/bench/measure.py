"""How the bench measures: processor time of this process, one BLAS thread, the least of several tries.

The machine may be shared. Processor time does not count what others use; the least of several tries drops what others
cost all the same, by caches and by clock rate. What is compared is measured turn by turn in one process.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

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
