"""Simulation: a scenario in flight, for people. Step it, break it, rewind it, fork it, look at it.

Everything that is done to a flight is a command, a value, and comes in by :meth:`ftcore.flight.Flight.do`; the methods
here build one and hand it over.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ftcore.commands import (
    Advance,
    Change,
    Clear,
    CommandError,
    Configure,
    FlightError,
    Inject,
    Rewind,
    Switch,
    made,
    plain,
)
from ftcore.description import Signal, View
from ftcore.events import Event
from ftcore.faults import Acted, Fault
from ftcore.flight import Flight
from ftcore.history import CHECKPOINTS
from ftcore.notebook import Notebook, Progress, progressing
from ftcore.operator import LiveFault, ended_by
from ftcore.recording import Recording, to_csv, to_parquet
from ftcore.scenario import Scenario
from ftcore.score import Score, compute
from ftcore.systems.base import HEALTH
from ftcore.threads import one_blas_thread

__all__ = ["CHECKPOINTS", "CommandError", "FlightError", "LiveFault", "Simulation", "SubsystemState"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SubsystemState:
    """A subsystem as the operator sees it (run 0)."""

    enabled: bool
    used: bool
    health: str


class Simulation(Notebook, Flight):
    """One scenario in flight, for one run or a batch of runs on the same commands.

    Args:
        scenario: what flies.
        runs: how many runs side by side; run k is the same alone and in any batch.
        seed: instead of the scenario's.
        max_epochs: bound on the recording; the older half is thinned when it is full. None: unbounded.
        first_run: index of the first run, to fly run k alone.
        signals: which signals are recorded, names or patterns such as ``"test.*"``; None: all. What is recorded
            changes neither the flight nor its score.

    Raises:
        ValueError: runs, seed or max_epochs out of range, or signals that the system does not have.
        CommandError: parameters that no system can be put together from.
    """

    # ---- what is done to it ------------------------------------------------------------------------------------------

    def inject(self, fault: Fault) -> Fault:
        """Lay a fault over a channel; start defaults to now. Returns it with its id.

        Raises:
            CommandError: the channel cannot take it; the message says what it takes.
        """
        return self.do(made(Inject, {"time": self.now, "fault": fault})).faults[0]

    def change(self, fault_id: str, **fields: Any) -> Fault:
        """Change magnitude, end or another field of a fault that is armed or active. Raises CommandError."""
        values = {"time": self.now, "fault": self._operator.find(fault_id).id, "fields": plain(fields)}
        return self.do(made(Change, values)).faults[0]

    def clear(self, fault_id: str) -> Fault:
        """End one fault now; the channel is truly restored. Raises CommandError if there is no such fault."""
        cleared = self.do(made(Clear, {"time": self.now, "fault": self._operator.find(fault_id).id})).faults
        return ended_by(cleared[0], self.now)

    def clear_all(self) -> list[Fault]:
        """End every fault that is armed or active. Returns them. Raises CommandError if the log has no room."""
        return [ended_by(fault, self.now) for fault in self.do(Clear(time=self.now)).faults]

    def switch(self, subsystem: str, enabled: bool) -> Self:
        """Switch a subsystem off or on. Raises CommandError for an unknown one."""
        self._operator.find_subsystem(subsystem)
        self.do(made(Switch, {"time": self.now, "subsystem": subsystem, "enabled": enabled}))
        return self

    def configure(self, **settings: Any) -> dict[str, Any]:
        """Change settings of the system. Returns all of them. Raises CommandError, naming the field."""
        self.do(made(Configure, {"time": self.now, "settings": plain(settings)}))
        return self.settings

    def advance(self, until: float | None = None, epochs: int | None = None, progress: Progress = None) -> Self:
        """Fly on until a time [s], or for a number of epochs, or to the end; never past the end.

        ``progress``: True for a bar (needs tqdm), or a function that is told, after each epoch, the time flown to and
        the time to fly to [s].

        Raises:
            CommandError: both or impossible arguments; or a command that waited is refused when its time comes.
            FlightError: FTLab fails; the flight stands as it was before.
            ImportError: a bar is wanted and tqdm is not installed.
        """
        command = made(Advance, {"time": self.now, "until": until, "epochs": epochs})
        if progress is None:
            self.do(command)
            return self
        goal = self.goal(command)
        with progressing(progress, self.scenario.id, self.now, goal * self.period) as tell:
            while self.epoch < goal:
                tell(self.step().now)
        return self

    def rewind(self, to: float) -> Self:
        """Go back to an earlier moment, as it was when the clock left it; what came later is forgotten.

        Raises:
            CommandError: outside the flight so far.
        """
        self._epoch_of("to", to)
        self.do(made(Rewind, {"time": self.now, "to": max(0.0, to)}))
        return self

    # ---- what there is to see -------------------------------------------------------------------------------------

    @property
    def time(self) -> Array:
        """Times of the recorded epochs [s]."""
        return self._recording.time.copy()

    @property
    def signals(self) -> Mapping[str, Signal]:
        """What is recorded: name -> label, unit, group."""
        return self._recording.signals

    def __getitem__(self, name: str) -> Array:
        """A recorded signal ``(epochs, runs)``, SI. Raises KeyError, naming near misses."""
        return self._recording[name]

    @property
    def recording(self) -> Recording:
        """The whole recording."""
        return self._recording

    @property
    def events(self) -> list[Event]:
        """What happened, in order."""
        return self._events

    @property
    def faults(self) -> list[LiveFault]:
        """All faults: armed, active and ended."""
        situation = self._situation()
        return [situation.standing(fault) for fault in self._operator.faults]

    @property
    def acted(self) -> Mapping[str, Acted]:
        """When each fault changed what the navigator was given: fault id -> times and epochs ``(runs,)``."""
        return {str(fault.id): self._state.deeds.of(fault, self.runs) for fault in self._operator.faults}

    @property
    def subsystems(self) -> dict[str, SubsystemState]:
        """Subsystems and how they fare in run 0."""
        column = {name: i for i, name in enumerate(self._assembly.subjects)}
        result = {}
        for name, enabled in self._operator.enabled.items():
            i = column.get(name)
            health = "off" if not enabled else "ok" if i is None else HEALTH[self._state.health[0, i]]
            used = enabled if i is None else enabled and bool(self._state.used[0, i])
            result[name] = SubsystemState(enabled, used, health)
        return result

    @property
    def unavailable(self) -> Mapping[str, str]:
        """Channels of the description that cannot fail here because they are not there, and why."""
        return self._assembly.absent

    @property
    def not_in_view(self) -> list[str]:
        """Channels without a reading in the last epoch of run 0, or in the first one before it is flown."""
        seen = self._seen()
        if seen is None:
            return []
        valid = {name: group.valid[0] for name, group in seen.groups.items()}
        return [
            channel.name
            for channel in self.description.channels
            if channel.name not in self.unavailable and not valid[channel.group][list(channel.parts)].any()
        ]

    @property
    def settings(self) -> dict[str, Any]:
        """Current settings."""
        settings: dict[str, Any] = self._operator.settings.model_dump(mode="json")
        return settings

    @property
    def idle_settings(self) -> Mapping[str, str]:
        """Settings that change nothing with the parameters of this flight and the other settings, and why."""
        idle: Mapping[str, str] = self._operator.settings.without_effect(
            self._rules.parameters, self._situation().settled
        )
        return idle

    def latest(self) -> dict[str, float]:
        """Last value of every signal of run 0, SI."""
        return self._recording.latest()

    def columns(
        self,
        names: list[str],
        start: float | None = None,
        end: float | None = None,
        points: int | None = None,
        run: int = 0,
    ) -> tuple[Array, dict[str, Array]]:
        """Time and columns of one run, decimated by extremes if ``points`` is given. Raises KeyError."""
        return self._recording.columns(names, start, end, points, run)

    @property
    def resolution(self) -> list[dict[str, float]]:
        """Where older history is coarser than the epoch."""
        return self._recording.resolution

    @one_blas_thread
    def view(self, at: float | None = None) -> View:
        """Diagram and scene of run 0, now or at an earlier moment. Raises CommandError outside the flight."""
        epoch = self.epoch if at is None else self._epoch_of("at", at)
        operator = self._operator if epoch == self.epoch else self._history.operator(epoch)
        time = epoch * self.period
        faulted = frozenset(f.channel for f in operator.faults if f.active(time) and epoch > 0)
        truth, output = self._shown_at(epoch)
        return self._assembly.reporter.view(time, truth, output, operator.controls, faulted)

    @one_blas_thread
    def score(self) -> Score:
        """The flight so far against the truth; see :mod:`ftcore.score`."""
        return compute(
            self._book,
            self._events,
            self._operator.faults,
            self.description,
            self._channels,
            self.acted,
            {str(live.fault.id): live.silent_because for live in self.faults},
            self.first_run,
            self.period,
            self.document(),
        )

    def document(self) -> Scenario:
        """The scenario with everything the operator did, ready to be flown again to the same bits."""
        # What is still to come has not happened here; it stays in the document.
        return self.scenario.model_copy(update={"commands": tuple(self._log), "seed": self.seed})

    def to_parquet(self, path: str | Path) -> None:
        """Write the recording as Parquet, whole or not at all: time, run, then all signals in SI. Raises OSError."""
        to_parquet(self._recording, path)

    def to_csv(self, path: str | Path) -> None:
        """Write the recording as CSV, whole or not at all: time, run, then all signals in SI. Raises OSError."""
        to_csv(self._recording, path)
