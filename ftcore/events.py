"""Events: typed and timed, with the subject and the numbers that caused them.

Alarms and health are compared with the epoch before; each edge in each run becomes one event.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from ftcore.faults import Fault
from ftcore.systems.base import HEALTH, Flags, Output

KINDS = (
    "fault.injected",
    "fault.started",
    "fault.ended",
    "fault.changed",
    "fault.cleared",
    "fault.acted",
    "fault.silent",
    "test.alarmed",
    "test.cleared",
    "subsystem.suspected",
    "subsystem.isolated",
    "subsystem.readmitted",
    "subsystem.switched",
    "settings.changed",
    "filter.reset",
    "filter.reflown",
    "filter.reopened",
    "imu.reconfigured",
    "channel.named",
    "integrity.cannot-isolate",
    "integrity.cannot-detect",
    "integrity.no-fix",
    "integrity.restored",
    "log.reading",
    "log.noise",
    "log.moving",
    "log.antenna",
)


class Event(BaseModel):
    """One thing that happened. ``run`` is -1 for what the operator did to all runs."""

    model_config = ConfigDict(frozen=True)

    index: int
    time: float
    run: int
    kind: str
    subject: str
    detail: dict[str, Any] = {}


_BECAME = {"isolated": "subsystem.isolated", "suspect": "subsystem.suspected"}

Raw = tuple[int, str, str, dict[str, Any]]
"""(run, kind, subject, detail)"""


def fault_detail(fault: Fault, unit: str | None) -> dict[str, Any]:
    """What an event says about a fault."""
    return {
        "id": fault.id,
        "channel": fault.channel,
        "kind": fault.kind,
        "magnitude": fault.magnitude,
        "unit": unit,
        "start": fault.start,
        "end": fault.end,
    }


def edges(
    output: Output,
    alarm_before: Flags,
    health_before: np.ndarray,
    tests: Sequence[tuple[str, str]],
    subjects: Sequence[str],
) -> Iterator[Raw]:
    """Events of one epoch: alarms that rose or fell, health that changed, and the navigator's notices."""
    for run, column in _where(output.alarm != alarm_before):
        name, subject = tests[column]
        kind = "test.alarmed" if output.alarm[run, column] else "test.cleared"
        yield (
            run,
            kind,
            subject,
            {
                "test": name,
                "statistic": _number(output.statistic[run, column]),
                "threshold": _number(output.threshold[run, column]),
                "dof": float(output.dof[run, column]),
            },
        )
    for run, column in _where(output.health != health_before):
        before, after = HEALTH[health_before[run, column]], HEALTH[output.health[run, column]]
        change: str | None = _BECAME.get(after)
        if after == "ok" and before == "isolated":
            change = "subsystem.readmitted"
        if change is not None:
            because = [
                {
                    "test": name,
                    "statistic": _number(output.statistic[run, i]),
                    "threshold": _number(output.threshold[run, i]),
                }
                for i, (name, subject) in enumerate(tests)
                if output.alarm[run, i] and subject == subjects[column]
            ]
            yield run, change, subjects[column], {"before": before, "alarms": because}
    for notice in output.notices:
        for run in np.flatnonzero(notice.where).tolist():
            numbers = {
                name: value if isinstance(value, str) else _number(np.broadcast_to(value, notice.where.shape)[run])
                for name, value in notice.numbers.items()
            }
            yield run, notice.kind, notice.subject, numbers


def _where(changed: Flags) -> Iterator[tuple[int, int]]:
    """Run and column of what is True, ``(runs, columns)``."""
    run, column = np.nonzero(changed)
    return zip(run.tolist(), column.tolist(), strict=True)


def _number(value: Any) -> float | None:
    """A number of an event; None where a test had nothing to judge: NaN is not even equal to itself."""
    return None if np.isnan(value) else float(value)
