"""Simulation: a scenario in flight. Step it, break it, rewind it, fork it.

State is a value, so a rewind goes back to an older one and a fork is two names for one. Checkpoints thin out as a
flight grows long; a moment between two of them is reached by replaying from the earlier one, to the same bits.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore import commands as desk
from ftcore import recording as table
from ftcore.acting import Deeds, follow, standing
from ftcore.commands import CommandError, FlightError, LiveFault, Operator
from ftcore.description import Signal, SystemDescription, View
from ftcore.events import Event, edges, fault_detail
from ftcore.faults import Acted, Fault
from ftcore.injection import FaultMemory, apply
from ftcore.noise import NoiseSource
from ftcore.prospects import Outlook, refuse_idle
from ftcore.readings import Readings
from ftcore.recording import Recording
from ftcore.scenario import Change, Clear, Command, Configure, Inject, Scenario, Switch
from ftcore.score import Score, compute
from ftcore.systems.base import HEALTH, Flags, Output, addresses, no_effect
from ftcore.threads import one_blas_thread

__all__ = ["CommandError", "FlightError", "LiveFault", "Simulation", "SubsystemState"]

Array = NDArray[np.float64]

CHECKPOINTS = 64
"""States kept for rewinding; a batch keeps fewer, so that memory stays bounded."""


@dataclass(frozen=True)
class SubsystemState:
    """A subsystem as the operator sees it (run 0)."""

    enabled: bool
    used: bool
    health: str


@dataclass(frozen=True)
class State:
    """Everything one epoch needs from the one before; a value."""

    epoch: int
    plant: Any
    navigator: Any
    memory: FaultMemory
    command: Any
    alarm: Flags
    health: NDArray[np.int8]
    used: Flags
    deeds: Deeds = field(default_factory=Deeds)


Shown = tuple[Any, Output]
"""Truth and output of an epoch: what its picture is drawn from."""


class Simulation:
    """One scenario in flight, for one run or a batch of runs on the same commands.

    Args:
        scenario: what flies.
        runs: how many runs side by side; run k is the same alone and in any batch.
        seed: instead of the scenario's.
        max_epochs: bound on the recording; the older half is thinned when it is full. None: unbounded.
        first_run: index of the first run, to fly run k alone.

    Raises:
        ValueError: runs, seed or max_epochs out of range.
        CommandError: parameters that no system can be put together from.
    """

    @one_blas_thread
    def __init__(
        self,
        scenario: Scenario,
        runs: int = 1,
        seed: int | None = None,
        max_epochs: int | None = None,
        first_run: int = 0,
    ) -> None:
        if runs < 1:
            raise ValueError(f"runs is {runs}; at least 1 is needed")
        self.scenario = scenario
        self.runs = runs
        self.seed = scenario.seed if seed is None else seed
        self.first_run = first_run
        system = scenario.model
        self.description: SystemDescription = system.description
        self._noise = NoiseSource(self.seed, range(first_run, first_run + runs))
        self._channels = addresses(self.description)
        self._parameters = system.Parameters.model_validate(scenario.parameters)
        try:
            self._assembly = system.assemble(self._parameters, scenario.duration, self._noise.runs, self._noise)
        except ValueError as error:
            # What only shows when the parts are put together, a receiver's log that cannot be read for instance.
            raise CommandError(getattr(error, "field", "parameters"), str(error)) from error
        self.period = self._assembly.period or self.description.epoch
        epochs = max(1, math.floor(scenario.duration / self.period + 1e-9))
        self.last_epoch = min(epochs, self._assembly.epochs or epochs)
        # A world that ends, a log, lasts as long as what is played of it.
        self.duration = scenario.duration if self._assembly.epochs is None else self.last_epoch * self.period
        enabled = {s.name: scenario.subsystems.get(s.name, True) for s in self.description.subsystems}
        self._operator = Operator((), enabled, system.Settings.model_validate(scenario.settings))
        tests, subjects = len(self._assembly.tests), len(self._assembly.subjects)
        self._state = State(
            0,
            self._assembly.plant.initial(),
            self._assembly.navigator.initial(self._operator.controls),
            FaultMemory(),
            None,
            np.zeros((runs, tests), bool),
            np.zeros((runs, subjects), np.int8),
            np.ones((runs, subjects), bool),
        )
        self._recording = Recording(self.description.signals, runs, self.period, max_epochs)
        self._first: Readings | None = None
        self._events: list[Event] = []
        self._log: list[Command] = []
        for remark in self._assembly.remarks:
            self._event(-1, remark.kind, remark.subject, {"text": remark.text, **remark.numbers})
        for i, fault in enumerate(scenario.faults):
            try:
                self._inject(fault.model_copy(update={"start": fault.start or 0.0}))
            except CommandError as error:
                raise CommandError(f"faults.{i}.{error.field}", str(error)) from None
        self._operators: list[tuple[int, Operator]] = [(0, self._operator)]
        self._shown: Shown | None = None
        self._every = 1
        self._checkpoints: dict[int, State] = {0: self._state}
        self._apply_script()

    # ---- what there is to see -------------------------------------------------------------------------------------

    @property
    def epoch(self) -> int:
        """Epochs flown."""
        return self._state.epoch

    @property
    def now(self) -> float:
        """Time of the last epoch [s]."""
        return self._state.epoch * self.period

    @property
    def finished(self) -> bool:
        """Whether the scenario's duration is over."""
        return self._state.epoch >= self.last_epoch

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
        seen = self._seen()
        enabled = self._operator.enabled
        return [
            standing(
                desk.live(fault, self.now, self._channels), self._state.deeds, enabled, self._channels, seen, self.runs
            )
            for fault in self._operator.faults
        ]

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
        return self._idle(self._operator.settings)

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
        operator = self._operator if epoch == self.epoch else self._operator_at(epoch)
        time = epoch * self.period
        faulted = frozenset(f.channel for f in operator.faults if f.active(time) and epoch > 0)
        truth, output = self._shown_at(epoch)
        return self._assembly.reporter.view(time, truth, output, operator.controls, faulted)

    @one_blas_thread
    def score(self) -> Score:
        """The flight so far against the truth; see :mod:`ftcore.score`."""
        return compute(
            self._recording,
            self._events,
            self._operator.faults,
            self.description,
            self._channels,
            self.acted,
            {str(live.fault.id): live.silent_because for live in self.faults},
            self.first_run,
        )

    def document(self) -> Scenario:
        """The scenario with everything the operator did, ready to be flown again to the same bits."""
        # What was scripted after `now` has not happened here; it stays in the document, as it is still to come.
        commands = sorted([*self.scenario.commands, *self._log], key=lambda c: c.time)
        return self.scenario.model_copy(update={"commands": tuple(commands), "seed": self.seed})

    def to_parquet(self, path: str | Path) -> None:
        """Write the recording as Parquet, whole or not at all: time, run, then all signals in SI. Raises OSError."""
        table.to_parquet(self._recording, path)

    def to_csv(self, path: str | Path) -> None:
        """Write the recording as CSV, whole or not at all: time, run, then all signals in SI. Raises OSError."""
        table.to_csv(self._recording, path)

    # ---- time -----------------------------------------------------------------------------------------------------

    @one_blas_thread
    def step(self) -> Simulation:
        """Fly one epoch; nothing happens when the flight is over.

        Raises:
            FlightError: FTLab fails; the flight stands as it was before.
            CommandError: a command of the scenario's own log is refused.
        """
        if self.finished:
            return self
        before = self._state
        try:
            after, truth, output = self._fly(before, self._operator)
            row = self._assembly.reporter.row(truth, output)
        except MemoryError:
            raise
        except Exception as error:
            raise FlightError(self.now, error) from error
        self._state, self._shown = after, (truth, output)
        self._recording.append(self.now, row)
        self._fault_edges(before.epoch * self.period, self.now)
        self._deed_edges(before.deeds)
        for run, kind, subject, detail in edges(
            output, before.alarm, before.health, self._assembly.tests, self._assembly.subjects
        ):
            self._event(run + self.first_run, kind, subject, detail)
        self._keep_checkpoint()
        self._apply_script()
        return self

    @one_blas_thread
    def advance(self, until: float | None = None, epochs: int | None = None) -> Simulation:
        """Fly on until a time [s], or for a number of epochs, or to the end; never past the end.

        Raises:
            CommandError: both or impossible arguments.
        """
        if until is not None and epochs is not None:
            raise CommandError("until", "give either until or epochs, not both")
        if epochs is not None and epochs < 0:
            raise CommandError("epochs", f"epochs is {epochs}; it must not be negative")
        if until is not None and (not math.isfinite(until) or until < self.now - 1e-9):
            raise CommandError(
                "until", f"until is {until} s, but the flight is at {self.now:g} s already; rewind first"
            )
        target = self.last_epoch
        if until is not None:
            target = min(target, math.floor(until / self.period + 1e-6))
        elif epochs is not None:
            target = min(target, self.epoch + epochs)
        while self.epoch < target:
            self.step()
        return self

    @one_blas_thread
    def rewind(self, to: float) -> Simulation:
        """Go back to an earlier moment, as it was when the clock left it; what came later is forgotten."""
        epoch = self._epoch_of("to", to)
        if epoch == self.epoch:
            return self
        (state, shown), operator = self._replayed(epoch), self._operator_at(epoch)
        time = epoch * self.period
        self._checkpoints = {e: s for e, s in self._checkpoints.items() if e <= epoch}
        self._operators = [(e, o) for e, o in self._operators if e <= epoch]
        self._state, self._shown, self._operator = state, shown, operator
        self._recording.truncate(time)
        self._events = [event for event in self._events if event.time <= time + 1e-9]
        self._log = [command for command in self._log if command.time <= time + 1e-9]
        return self

    @one_blas_thread
    def fork(self, at: float | None = None) -> Simulation:
        """A second flight that shares the past up to ``at`` (default now) and has its own future."""
        epoch = self.epoch if at is None else self._epoch_of("at", at)
        time = epoch * self.period
        twin = object.__new__(Simulation)
        twin.__dict__.update(self.__dict__)
        twin._recording = self._recording.copy_until(time)
        twin._events = [event for event in self._events if event.time <= time + 1e-9]
        twin._log = [command for command in self._log if command.time <= time + 1e-9]
        twin._state, twin._shown = self._replayed(epoch)
        twin._operator = self._operator_at(epoch)
        twin._operators = [(e, o) for e, o in self._operators if e <= epoch]
        twin._checkpoints = {e: s for e, s in self._checkpoints.items() if e <= epoch}
        twin._noise = NoiseSource(self.seed, self._noise.runs)
        system = self.scenario.model
        parameters = system.Parameters.model_validate(self.scenario.parameters)
        # Plant and navigator are pure; a new set only keeps the noise memo of two live branches apart.
        twin._assembly = system.assemble(parameters, self.scenario.duration, twin._noise.runs, twin._noise)
        return twin

    # ---- the operator's commands ----------------------------------------------------------------------------------

    def inject(self, fault: Fault) -> Fault:
        """Lay a fault over a channel; start defaults to now. Returns it with its id.

        Raises:
            CommandError: the channel cannot take it; the message says what it takes.
        """
        injected = self._inject(fault)
        self._given(Inject(action="inject", time=self.now, fault=injected))
        return injected

    def change(self, fault_id: str, **fields: Any) -> Fault:
        """Change magnitude, end or another field of a fault that is armed or active. Raises CommandError."""
        absent = self._assembly.absent
        after, new = desk.change(self._operator, fault_id, fields, self.now, self._channels, absent)
        acted = bool(self._state.deeds.of(new, self.runs).epochs.any())
        refuse_idle(new, self._channels[new.channel], self._outlook(), acted)
        self._operator = after
        self._fault_event("fault.changed", new)
        self._given(Change(action="change", time=self.now, fault=fault_id, fields=fields))
        return new

    def clear(self, fault_id: str) -> Fault:
        """End one fault now; the channel is truly restored. Raises CommandError if there is no such fault."""
        before = self._operator
        self._operator, ended = desk.clear(before, fault_id, self.now, self._channels)
        if self._operator is not before:
            self._fault_event("fault.cleared", ended)
            if any(fault.id == ended.id for fault in self._operator.faults):
                self._say_if_silent(ended)
            self._given(Clear(action="clear", time=self.now, fault=fault_id))
        return ended

    def clear_all(self) -> list[Fault]:
        """End every fault that is armed or active."""
        return [self.clear(str(f.fault.id)) for f in self.faults if f.state != "ended"]

    def switch(self, subsystem: str, enabled: bool) -> Simulation:
        """Switch a subsystem off or on. Raises CommandError for an unknown one."""
        after = desk.switch(self._operator, subsystem, enabled)
        if after.enabled != self._operator.enabled:
            self._operator = after
            self._event(-1, "subsystem.switched", subsystem, {"enabled": enabled})
            self._given(Switch(action="switch", time=self.now, subsystem=subsystem, enabled=enabled))
        return self

    def configure(self, **settings: Any) -> dict[str, Any]:
        """Change settings of the system. Returns all of them. Raises CommandError, naming the field."""
        after = desk.configure(self._operator, self.scenario.model.Settings, settings)
        for name, why in self._idle(after.settings).items():
            if getattr(after.settings, name) != getattr(self._operator.settings, name):
                raise CommandError(name, no_effect(name, why))
        if after.settings != self._operator.settings:
            self._operator = after
            self._event(-1, "settings.changed", "settings", dict(settings))
            self._given(Configure(action="configure", time=self.now, settings=settings))
        return self.settings

    # ---- inside ---------------------------------------------------------------------------------------------------

    def _fly(self, state: State, operator: Operator) -> tuple[State, Any, Output]:
        """One epoch as a pure function: plant, faults, navigator."""
        epoch = state.epoch + 1
        plant, truth, clean = self._assembly.plant.step(state.plant, epoch, state.command)
        memory, readings, effects = apply(
            operator.faults, self._channels, state.memory, clean, self._noise, epoch, self.period
        )
        navigator, output = self._assembly.navigator.step(state.navigator, readings, operator.controls)
        deeds = follow(state.deeds, effects, operator, self._channels, output, epoch * self.period)
        after = State(epoch, plant, navigator, memory, output.command, output.alarm, output.health, output.used, deeds)
        return after, truth, output

    def _inject(self, fault: Fault) -> Fault:
        absent = self._assembly.absent
        after, injected = desk.inject(self._operator, fault, self.now, self._channels, absent)
        refuse_idle(injected, self._channels[injected.channel], self._outlook())
        self._operator = after
        self._fault_event("fault.injected", injected)
        return injected

    def _idle(self, settings: Any) -> Mapping[str, str]:
        settled = not np.isin(self._state.health, (HEALTH.index("suspect"), HEALTH.index("isolated"))).any()
        idle: Mapping[str, str] = settings.without_effect(self._parameters, settled)
        return idle

    def _outlook(self) -> Outlook:
        return Outlook(self._seen(), self.epoch, self.last_epoch, self.period, self._assembly.visible)

    def _seen(self) -> Readings | None:
        """Clean readings of the last epoch; of the first one before it is flown, if that can be known."""
        if self._state.memory.history:
            return self._state.memory.history[-1]
        if self._first is None and self._assembly.foresees:
            self._first = self._assembly.plant.step(self._state.plant, 1, None)[2]
        return self._first

    def _given(self, command: Command) -> None:
        """Remember a command: in the log, unless the scenario's own log gave it, and as the operator's new state."""
        if not self._replaying:
            self._log.append(command)
        self._keep_operator()

    def _keep_operator(self) -> None:
        if self._operators[-1][0] == self.epoch:
            self._operators.pop()
        self._operators.append((self.epoch, self._operator))

    _replaying = False

    def _apply_script(self) -> None:
        """Give the commands of the scenario's own log whose time has come."""
        script = self.scenario.commands
        while self._operator.scripted < len(script) and script[self._operator.scripted].time <= self.now + 1e-9:
            command = script[self._operator.scripted]
            self._operator = replace(self._operator, scripted=self._operator.scripted + 1)
            self._replaying = True
            try:
                match command:
                    case Inject():
                        # Given between two epochs, it is laid at the next one; so is its onset.
                        due = command.fault.start is not None and command.fault.start < self.now
                        self.inject(command.fault.model_copy(update={"start": self.now} if due else {}))
                    case Change():
                        self.change(command.fault, **command.fields)
                    case Clear(fault=None):
                        self.clear_all()
                    case Clear():
                        self.clear(str(command.fault))
                    case Switch():
                        self.switch(command.subsystem, command.enabled)
                    case Configure():
                        self.configure(**command.settings)
            finally:
                self._replaying = False
            self._keep_operator()

    def _keep_checkpoint(self) -> None:
        if self.epoch % self._every == 0:
            self._checkpoints[self.epoch] = self._state
        if len(self._checkpoints) > max(4, CHECKPOINTS // self.runs):
            self._every *= 2
            self._checkpoints = {e: s for e, s in self._checkpoints.items() if e % self._every == 0}

    def _operator_at(self, epoch: int) -> Operator:
        return self._operators[bisect_right(self._operators, epoch, key=lambda pair: pair[0]) - 1][1]

    def _replayed(self, epoch: int) -> tuple[State, Shown | None]:
        """State at an earlier epoch or now, and what it showed if that came by on the way there."""
        if epoch == self.epoch:
            return self._state, self._shown
        state = self._checkpoints[max(e for e in self._checkpoints if e <= epoch)]
        shown: Shown | None = None
        while state.epoch < epoch:
            state, truth, output = self._fly(state, self._operator_at(state.epoch))
            shown = (truth, output)
        return state, shown

    def _shown_at(self, epoch: int) -> Shown | tuple[None, None]:
        """Truth and output of an epoch; of the one that is now without flying it again. Nothing before the first."""
        if epoch == 0:
            return None, None
        shown = self._replayed(epoch)[1]
        if shown is None:
            # A checkpoint holds what the next epoch needs, not what this one showed.
            _, truth, output = self._fly(self._replayed(epoch - 1)[0], self._operator_at(epoch - 1))
            shown = (truth, output)
            if epoch == self.epoch:
                self._shown = shown
        return shown

    def _epoch_of(self, field: str, time: float) -> int:
        if not math.isfinite(time) or not -1e-9 <= time <= self.now + 1e-9:
            raise CommandError(field, f"{time:g} s lies outside the flight so far, which is 0 to {self.now:g} s")
        return round(time / self.period)

    def _fault_edges(self, before: float, now: float) -> None:
        for fault in self._operator.faults:
            assert fault.start is not None
            if before < fault.start <= now or (before == 0.0 == fault.start):
                self._fault_event("fault.started", fault)
            if fault.end is not None and before < fault.end <= now:
                self._fault_event("fault.ended", fault)
                self._say_if_silent(fault)

    def _deed_edges(self, before: Deeds) -> None:
        """Events of faults that act for the first time, and at the end of the flight of those that never did."""
        for fault in self._operator.faults:
            if before.of(fault, self.runs).epochs.all():
                continue
            for run in np.flatnonzero(self._state.deeds.of(fault, self.runs).first == self.now).tolist():
                self._fault_event("fault.acted", fault, run + self.first_run)
            if self.finished and (fault.end is None or fault.end > self.now):
                self._say_if_silent(fault)

    def _say_if_silent(self, fault: Fault) -> None:
        """An event for a fault that is over, or lasts until the flight is, and has acted in no run."""
        if not self._state.deeds.of(fault, self.runs).epochs.any():
            live = next(live for live in self.faults if live.fault.id == fault.id)
            self._fault_event("fault.silent", fault, because=live.silent_because)

    def _fault_event(self, kind: str, fault: Fault, run: int = -1, **more: Any) -> None:
        detail = fault_detail(fault, desk.unit_of(fault, self._channels)) | more
        self._event(run, kind, self._channels[fault.channel].sensor, detail)

    def _event(self, run: int, kind: str, subject: str, detail: dict[str, Any]) -> None:
        self._events.append(
            Event(index=len(self._events), time=self.now, run=run, kind=kind, subject=subject, detail=detail)
        )
