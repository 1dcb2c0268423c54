"""What the server takes beside the core's commands, and what it answers to any of them: values both.

Every command reaches an experiment by :meth:`server.experiments.Experiment.do`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeVar

from ftcore import commands
from ftcore.documents import Seconds, Strict
from ftcore.events import Event
from server.models import ExperimentState, FaultState
from server.pacing import Speed


class Clock(Strict):
    """Run, pause, or change the speed of an experiment; what is absent stays as it is."""

    action: Literal["clock"] = "clock"
    time: Seconds
    state: Literal["running", "paused"] | None = None
    speed: Speed | None = None


Command = commands.Command | Clock
"""Everything that can be done to an experiment."""


@dataclass(frozen=True)
class Done:
    """What came of a command, seen before anything else was done to the experiment.

    Attributes:
        state: the experiment afterwards.
        answer: of the flight; None where only the clock was asked.
        faults: those that were injected, changed or ended.
        events: what happened during an advance.
        latest: last value of every signal after an advance, SI.
    """

    state: ExperimentState
    answer: commands.Answer | None = None
    faults: tuple[FaultState, ...] = ()
    events: tuple[Event, ...] = ()
    latest: dict[str, float] = field(default_factory=dict)


C = TypeVar("C", commands.Advance, commands.Rewind, commands.OperatorCommand)


def not_past(command: C, now: float) -> C:
    """A command whose time went by while it waited for its turn, as one of ``now`` [s]."""
    return command.model_copy(update={"time": now}) if command.time < now else command
