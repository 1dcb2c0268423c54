"""What a notebook needs to know of a flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from ftcore.description import Signal, SystemDescription
from ftcore.events import Event
from ftcore.operator import LiveFault
from ftcore.recording import Recording
from ftcore.scenario import Scenario


class Flown(Protocol):
    """A simulation, seen from here; see :class:`ftcore.simulation.Simulation`."""

    @property
    def scenario(self) -> Scenario: ...  # noqa: D102
    @property
    def description(self) -> SystemDescription: ...  # noqa: D102
    @property
    def runs(self) -> int: ...  # noqa: D102
    @property
    def first_run(self) -> int: ...  # noqa: D102
    @property
    def seed(self) -> int: ...  # noqa: D102
    @property
    def now(self) -> float: ...  # noqa: D102
    @property
    def duration(self) -> float: ...  # noqa: D102
    @property
    def signals(self) -> Mapping[str, Signal]: ...  # noqa: D102
    @property
    def recording(self) -> Recording: ...  # noqa: D102
    @property
    def events(self) -> Sequence[Event]: ...  # noqa: D102
    @property
    def faults(self) -> Sequence[LiveFault]: ...  # noqa: D102
