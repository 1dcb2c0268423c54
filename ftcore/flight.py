"""Flight: a scenario flown epoch by epoch, and the one way in for everything that is done to it.

State is a value, so a rewind goes back to an older one and a fork is two names for one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Self

import numpy as np

from ftcore.acting import Situation, follow
from ftcore.commandlog import CommandLog
from ftcore.commands import Advance, Answer, Command, CommandError, FlightError, Inject, OperatorCommand, Rewind, place
from ftcore.description import SystemDescription
from ftcore.events import Event, Raw, edges
from ftcore.execution import Execution, Rules, execute, foresee
from ftcore.history import History, State
from ftcore.injection import FaultMemory, apply
from ftcore.noise import NoiseSource
from ftcore.operator import Operator
from ftcore.prospects import Outlook
from ftcore.readings import Readings
from ftcore.recording import Recording
from ftcore.scenario import Scenario
from ftcore.score import Book
from ftcore.systems.base import HEALTH, Output, addresses
from ftcore.threads import one_blas_thread

Shown = tuple[Any, Output]
"""Truth and output of an epoch: what its picture is drawn from."""


class Flight:
    """A scenario in flight; :class:`ftcore.simulation.Simulation` is what people use, and describes the arguments."""

    @one_blas_thread
    def __init__(
        self,
        scenario: Scenario,
        runs: int = 1,
        seed: int | None = None,
        max_epochs: int | None = None,
        first_run: int = 0,
        signals: Iterable[str] | None = None,
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
        parameters = system.Parameters.model_validate(scenario.parameters)
        try:
            self._assembly = system.assemble(parameters, scenario.duration, self._noise.runs, self._noise)
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
        self._recording = Recording(self.description.signals, runs, self.period, max_epochs, signals)
        self._book = Book(self.description, runs, max_epochs)
        self._first: Readings | None = None
        self._events: list[Event] = []
        self._log = CommandLog.of(scenario.commands)
        self._rules = Rules(self._assembly.absent, parameters, system.Settings)
        self._note((-1, r.kind, r.subject, {"text": r.text, **r.numbers}) for r in self._assembly.remarks)
        self._shown: Shown | None = None
        self._history = History(self._state, self._operator, runs)
        for i, fault in enumerate(scenario.faults):
            laid = fault.model_copy(update={"start": fault.start or 0.0})
            try:
                self._publish(self._executed(Inject(time=0.0, fault=laid)))
            except CommandError as error:
                raise CommandError(f"faults.{i}.{error.field}", str(error)) from None
        self._do_what_is_due()
        self._history.commanded(0, self._operator)

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

    # ---- the one way in ---------------------------------------------------------------------------------------------

    @one_blas_thread
    def do(self, command: Command) -> Answer:
        """Do a command, whichever; all other methods that do something to the flight build one and come here.

        Its time is that of the flight as it stands, or a later one: then what the operator does waits for it, and an
        advance or a rewind flies there first. So ``for command in log: do(command)`` flies a log again.

        Args:
            command: a value of :mod:`ftcore.commands`.

        Returns:
            What came of it; a value too.

        Raises:
            CommandError: refused; nothing has changed. An advance also raises it where a command that waited is
                refused when its time comes: the flight then stands before that epoch, and the command waits on.
            FlightError: FTLab fails in an epoch; the flight stands as it was before.
        """
        end = self.last_epoch * self.period
        if command.time < self.now - 1e-9:
            raise CommandError("time", f"time is {command.time:g} s, but the flight is at {self.now:g} s; rewind first")
        if command.time > end + 1e-9:
            raise CommandError("time", f"time is {command.time:g} s, but the flight ends at {end:g} s; give it before")
        match command:
            case Advance():
                return self._advance(command)
            case Rewind():
                return self._rewind(command)
            case _:
                return self._operate(command)

    def goal(self, command: Advance) -> int:
        """Epoch that an advance flies to. Raises CommandError where it makes no sense."""
        if command.until is not None and command.epochs is not None:
            raise CommandError("until", "give either until or epochs, not both")
        begin = max(self.now, command.time)
        if command.until is not None and command.until < begin - 1e-9:
            raise CommandError(
                "until", f"until is {command.until:g} s, but the flight is at {begin:g} s already; rewind first"
            )
        if command.until is not None:
            return min(self.last_epoch, math.floor(command.until / self.period + 1e-6))
        if command.epochs is not None:
            return min(self.last_epoch, math.ceil((begin - 1e-9) / self.period) + command.epochs)
        return self.last_epoch

    # ---- time -----------------------------------------------------------------------------------------------------

    @one_blas_thread
    def step(self) -> Self:
        """Fly one epoch; nothing happens when the flight is over.

        Raises:
            FlightError: FTLab fails; the flight stands as it was before.
            CommandError: a command whose time has come is refused; the flight stands as it was before.
        """
        if self.finished:
            return self
        before = self._state, self._shown, self._operator, self._log
        events = len(self._events)
        try:
            after, truth, output = self._fly(self._state, self._operator)
            row = self._assembly.reporter.row(truth, output)
        except MemoryError:
            raise
        except Exception as error:
            raise FlightError(self.now, error) from error
        past = self._state
        self._state, self._shown = after, (truth, output)
        try:
            if self._operator.faults:
                self._note(self._situation().edges(past.epoch * self.period, past.deeds, self.finished))
            self._note(edges(output, past.alarm, past.health, self._assembly.tests, self._assembly.subjects))
            self._do_what_is_due()
        except BaseException:
            self._state, self._shown, self._operator, self._log = before
            del self._events[events:]
            raise
        self._recording.append(self.now, row)
        self._book.append(self.now, row)
        self._history.flown(after)
        if self._operator is not before[2]:
            self._history.commanded(self.epoch, self._operator)
        return self

    @one_blas_thread
    def fork(self, at: float | None = None) -> Self:
        """A second flight that shares the past up to ``at`` (default now) and has its own future."""
        epoch = self.epoch if at is None else self._epoch_of("at", at)
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        twin._recording = self._recording.copy_until(epoch * self.period)
        twin._book = self._book.copy(len(twin._recording))
        twin._go_back(epoch)
        twin._noise = NoiseSource(self.seed, self._noise.runs)
        system = self.scenario.model
        parameters = system.Parameters.model_validate(self.scenario.parameters)
        # Plant and navigator are pure; a new set only keeps the noise memo of two live branches apart.
        twin._assembly = system.assemble(parameters, self.scenario.duration, twin._noise.runs, twin._noise)
        return twin

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

    def _advance(self, command: Advance) -> Answer:
        begin, goal = self.epoch, self.goal(command)
        while self.epoch < goal:
            self.step()
        return Answer(command=command, outcome="done" if self.epoch > begin else "unchanged", time=self.now)

    def _rewind(self, command: Rewind) -> Answer:
        if command.to > command.time + 1e-9:
            raise CommandError("to", f"{command.to:g} s lies after {command.time:g} s, when the flight is rewound")
        while self.now < command.time - 1e-9:
            self.step()
        epoch, begin = self._epoch_of("to", command.to), self.epoch
        if epoch < begin:
            self._go_back(epoch)
            self._recording.truncate(self.now)
            self._book.truncate(len(self._recording))
        return Answer(command=command, outcome="done" if epoch < begin else "unchanged", time=self.now)

    def _go_back(self, epoch: int) -> None:
        """Be as at the end of an earlier epoch, or as now, in values that no other flight shares."""
        time = epoch * self.period
        if epoch < self.epoch:
            self._log = self._log.until(time)
        self._state, self._shown = self._replayed(epoch)
        self._operator = self._history.operator(epoch)
        self._history = self._history.until(epoch)
        self._events = [event for event in self._events if event.time <= time + 1e-9]

    def _operate(self, command: OperatorCommand) -> Answer:
        if command.time > self.now + 1e-9:
            foresee(command, self._situation(), self._rules)
            self._log = self._log.with_waiting(command)
            return Answer(command=command, outcome="scheduled", time=self.now)
        done = self._executed(command)
        if done.operator is self._operator:
            return Answer(command=done.command, outcome="unchanged", time=self.now, faults=done.faults)
        self._log = self._log.with_done(done.command)
        self._publish(done)
        self._history.commanded(self.epoch, self._operator)
        return Answer(command=done.command, outcome="done", time=self.now, faults=done.faults)

    def _executed(self, command: OperatorCommand) -> Execution:
        return execute(command, self._situation(), self._rules, self._outlook)

    def _publish(self, done: Execution) -> None:
        """Take over what a command does."""
        self._operator = done.operator
        self._note(done.events)

    def _do_what_is_due(self) -> None:
        """Do the commands that waited and whose time has come. Raises CommandError, with the command's place."""
        while (command := self._log.due(self.now)) is not None:
            try:
                done = self._executed(_given_between(command, self.now))
            except CommandError as error:
                at = [f"commands.{i}." for i, one in enumerate(self.scenario.commands) if one is command]
                what = f"the scenario's command at {command.time:g} s is refused: {error}"
                raise CommandError("".join(at) + place(command, error.field), what) from None
            if done.operator is not self._operator:
                self._publish(done)
            self._log = self._log.next(done.command)

    def _situation(self) -> Situation:
        state = self._state
        settled = not np.isin(state.health, (HEALTH.index("suspect"), HEALTH.index("isolated"))).any()
        return Situation(self._operator, state.deeds, self._channels, self._seen(), self.now, self.runs, settled)

    def _outlook(self) -> Outlook:
        return Outlook(self._seen(), self.epoch, self.last_epoch, self.period, self._assembly.visible)

    def _seen(self) -> Readings | None:
        """Clean readings of the last epoch; of the first one before it is flown, if that can be known."""
        if self._state.memory.history:
            return self._state.memory.history[-1]
        if self._first is None and self._assembly.foresees:
            self._first = self._assembly.plant.step(self._state.plant, 1, None)[2]
        return self._first

    def _replayed(self, epoch: int) -> tuple[State, Shown | None]:
        """State at an earlier epoch or now, and what it showed if that came by on the way there."""
        if epoch == self.epoch:
            return self._state, self._shown
        state = self._history.checkpoint(epoch)
        shown: Shown | None = None
        while state.epoch < epoch:
            state, truth, output = self._fly(state, self._history.operator(state.epoch))
            shown = (truth, output)
        return state, shown

    def _shown_at(self, epoch: int) -> Shown | tuple[None, None]:
        """Truth and output of an epoch; of the one that is now without flying it again. Nothing before the first."""
        if epoch == 0:
            return None, None
        shown = self._replayed(epoch)[1]
        if shown is None:
            # A checkpoint holds what the next epoch needs, not what this one showed.
            _, truth, output = self._fly(self._replayed(epoch - 1)[0], self._history.operator(epoch - 1))
            shown = (truth, output)
            if epoch == self.epoch:
                self._shown = shown
        return shown

    def _epoch_of(self, field: str, time: float) -> int:
        if not math.isfinite(time) or not -1e-9 <= time <= self.now + 1e-9:
            raise CommandError(field, f"{time:g} s lies outside the flight so far, which is 0 to {self.now:g} s")
        return round(time / self.period)

    def _note(self, events: Iterable[Raw]) -> None:
        """Add events of now to the list; those of all runs have the run -1."""
        for run, kind, subject, detail in events:
            number = run if run < 0 else run + self.first_run
            index = len(self._events)
            self._events.append(
                Event(index=index, time=self.now, run=number, kind=kind, subject=subject, detail=detail)
            )


def _given_between(command: OperatorCommand, now: float) -> OperatorCommand:
    """A command that was given between two epochs, as it is done at the next one, ``now`` [s]."""
    if isinstance(command, Inject) and command.fault.start is not None and command.fault.start < now:
        return command.model_copy(update={"fault": command.fault.model_copy(update={"start": now})})
    return command
