"""Experiment: a simulation, its clock, and who watches it.

The clock flies in slices of a few milliseconds and lets others have their turns between them, so a command always lands
between two epochs, soon.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import TypeVar

from ftcore import CommandError, FlightError, Simulation, commands
from ftcore.description import View
from server.advances import Job, Stop
from server.attendance import PATIENCE, Attendance, Subscriber
from server.commands import Clock, Command, Done, not_past
from server.faults import fault_state, shown
from server.models import ClockState, ExperimentState, ScenarioLabel, State, SubsystemStatus
from server.pacing import Pacer
from server.problems import INTERNAL_FAILURE, Refused
from server.turns import Turns, Workers

T = TypeVar("T")
SLICE = 0.012
"""Longest turn of a clock [s]; the epoch that is under way is finished."""
LEFT_ALONE = f"the run was paused because no page had watched it for {PATIENCE:g} s"
_log = logging.getLogger("ftlab")


class Experiment:
    """One experiment. Lives on the event loop.

    Args:
        id: its name in the API.
        simulation: what flies; the experiment's alone from now on.
        workers: who does the flying.
        parent: the experiment it was forked from.
        ghost_of: the experiment it is the fault-free twin of.
    """

    def __init__(
        self,
        id: str,
        simulation: Simulation,
        workers: Workers,
        title: str | None = None,
        parent: str | None = None,
        ghost_of: str | None = None,
    ) -> None:
        self.id = id
        self.title = title or simulation.scenario.title
        self.parent = parent
        self.ghost_of = ghost_of
        self.description = simulation.description
        self.signals = frozenset(signal.name for signal in self.description.signals)
        self.scenario = simulation.scenario
        self.version = 0
        self.cursor: float | None = None
        self.picture = next((item.picture for item in self.description.scene), "")
        self.reusable = False
        self.subscribers: set[Subscriber] = set()
        self.attendance = Attendance(workers.clock.now)
        self.rewinds: list[float] = []
        self.reason: str | None = None
        self._defect: FlightError | None = None
        self._simulation = simulation
        self._clock = workers.clock
        self._turns = Turns(workers)
        self._state: State = "paused"
        self._pacer = Pacer(simulation.period, 1.0, 0, 0.0)
        self._nudge = asyncio.Event()
        self._flight: asyncio.Task[None] | None = None
        self._advance: Job | None = None
        self._view: tuple[int, View] | None = None
        self.closed = False

    # ---- taking turns ---------------------------------------------------------------------------------------------

    async def read(self, look: Callable[[Simulation], T]) -> T:
        """Look at the simulation, in a thread, while nobody else has it."""
        return await self._turns.alone(lambda: look(self._simulation))

    @property
    def now(self) -> float:
        """Time of the last epoch [s]; a flight that is under way may be further when a command's turn comes."""
        return self._simulation.now

    async def do(self, command: Command, job: Job | None = None) -> Done:
        """Do a command between two epochs, whoever sends it; whoever watches is told. The one way in.

        A command whose time has gone by when its turn comes is done then.

        Args:
            command: a value.
            job: what an advance is stopped by.

        Raises:
            CommandError: refused, nothing has changed.
            Refused: the experiment was deleted meanwhile, the flight is over or has failed, or an advance flies that
                the command would disturb; for an advance, also that it failed or was stopped on its way.
        """
        match command:
            case Clock():
                self._set_clock(command)
                return Done(await self.state())
            case commands.Advance():
                return await self._fly(command, job or Job())
            case commands.Rewind():
                return await self._rewind(command)
            case _:
                done = await self.read(lambda simulation: self._done(simulation, command))
                self._publish(at_once=True)
                return done

    def _done(self, simulation: Simulation, command: commands.OperatorCommand) -> Done:
        """Do a command, for one who has the simulation."""
        self._still_there()
        answer = simulation.do(not_past(command, simulation.now))
        faults = tuple(fault_state(simulation, fault) for fault in answer.faults)
        return Done(self.describe(simulation), answer, faults)

    def _still_there(self) -> None:
        """Raise Refused if the experiment was deleted after a request had found it."""
        if self.closed:
            raise Refused(410, f"the experiment {self.id!r} was deleted meanwhile")

    async def _turn(self, fly: Callable[[], None]) -> None:
        """One slice of flight, in a worker."""
        await self._turns.fly(fly)
        self._publish()

    def _fly_while(self, more: Callable[[int], bool]) -> None:
        """In a worker: step while ``more`` says so of the epoch, and until the slice is used up."""
        enough = self._clock.now() + SLICE
        while more(self._simulation.epoch) and not self._simulation.finished:
            self._simulation.step()
            if self._clock.now() >= enough:
                break

    def _fly_by_the_clock(self) -> None:
        """In a worker: fly what is due when the turn begins. A clock that was stopped meanwhile flies nowhere."""
        pacer = self._pacer
        if self._state == "running" and self._advance is None:
            due = pacer.due(self._simulation.epoch, self._clock.now())
            self._fly_while(lambda epoch: due is None or epoch < due)
            pacer.flown(self._simulation.epoch)

    def _publish(self, at_once: bool = False) -> None:
        self.version += 1
        if self._simulation.finished and self._state in ("paused", "running"):
            self._state = "finished"
        elif not self._simulation.finished and self._state == "finished":
            self._state = "paused"
        for subscriber in self.subscribers:
            subscriber.changed(at_once)

    # ---- the clock ------------------------------------------------------------------------------------------------

    def _set_clock(self, clock: Clock) -> None:
        """Run, pause, or change the speed. A pause also stops an advance, after the epoch that is under way.

        Raises:
            Refused: the flight is over or has failed, or an advance flies that a running clock would overrun.
        """
        self._still_there()
        if clock.state == "running":
            self._may_fly()
            self._no_other_advance("pause the clock first, or wait for its end")
            self.reason = None
        elif clock.state == "paused":
            self.stop_advance("paused")
        self.attendance.commanded()
        starts = clock.state == "running" and self._state == "paused"
        if starts or clock.speed is not None:
            kept = self._pacer.speed if clock.speed is None else clock.speed
            self._pacer = Pacer(self._simulation.period, kept, self._simulation.epoch, self._clock.now())
        if starts:
            self._state = "running"
            if self._flight is None or self._flight.done():
                self._flight = asyncio.create_task(self._run(), name=f"clock of {self.id}")
        elif clock.state == "paused" and self._state == "running":
            self._state = "paused"
        self._nudge.set()
        self._publish(at_once=True)

    def _may_fly(self) -> None:
        if self._state == "failed":
            if self._defect is not None:
                raise Refused(409, str(self._defect), type=INTERNAL_FAILURE)
            raise Refused(409, f"the experiment has failed ({self.reason}); rewind it, or fork from before")
        if self._state == "finished":
            raise Refused(409, f"the flight is over at {self._simulation.now:g} s; rewind it, or fork from before")

    async def _run(self) -> None:
        """Fly at the clock's pace until paused, finished, failed or closed; an advance has the flight to itself."""
        while self._state == "running" and not self.closed:
            if self.attendance.abandoned:
                self._leave_alone()
                return
            self._nudge.clear()
            if self._advance is not None:
                await self._nudge.wait()
                continue
            wait = self._pacer.wait(self._simulation.epoch, self._clock.now())
            if wait > 0.0 and await self._clock.happens_within(self._nudge, wait):
                continue
            try:
                await self._turn(self._fly_by_the_clock)
            except Exception as error:
                self._fail(error)

    def _leave_alone(self) -> None:
        """Pause a run that a page started and no page watches any more; the clock says why."""
        _log.info("experiment %s: %s", self.id, LEFT_ALONE)
        self._state, self.reason = "paused", LEFT_ALONE
        self._publish(at_once=True)

    def _fail(self, error: Exception) -> None:
        _log.exception("experiment %s failed", self.id, exc_info=error)
        self._state = "failed"
        self._defect = error if isinstance(error, FlightError) else None
        text = str(error) if isinstance(error, CommandError) else f"{type(error).__name__}: {error}"
        self.reason = self._defect.reason if self._defect else text.splitlines()[0][:300]
        self._publish()

    async def _fly(self, command: commands.Advance, job: Job) -> Done:
        """Fly as fast as it goes to where the command says now; others get their turns in between.

        Raises:
            Refused: another advance flies, the experiment has failed or fails on the way, or the flight was stopped.
        """
        self._no_other_advance("pause the clock to stop it, or wait for its end")
        if self.closed:
            job.stop("deleted")
        self._advance = job
        first_event = 0

        def departs(simulation: Simulation) -> int:
            nonlocal first_event
            first_event = len(simulation.events)
            goal = simulation.goal(not_past(command, simulation.now))
            job.refuse_more(goal - simulation.epoch, "until" if command.epochs is None else "epochs")
            return goal

        def landed(simulation: Simulation) -> Done:
            assert job.goal is not None
            if simulation.epoch < job.goal or job.stopped == "rewound":
                raise job.refusal(simulation.epoch, simulation.period)
            events = tuple(simulation.events[first_event:])
            return Done(self.describe(simulation), events=events, latest=simulation.latest())

        try:
            job.goal = await self.read(departs)
            while job.flies(self._simulation.epoch):
                if self._state == "failed":
                    self._may_fly()
                try:
                    await self._turn(lambda: self._fly_while(job.flies))
                except Exception as error:
                    self._fail(error)
            return await self.read(landed)
        finally:
            if self._advance is job:
                self._advance = None
                self._pacer = Pacer(
                    self._simulation.period, self._pacer.speed, self._simulation.epoch, self._clock.now()
                )
                self._nudge.set()
                self._publish(at_once=True)

    def stop_advance(self, why: Stop) -> None:
        """Stop the advance that flies, if one does, after the epoch that is under way."""
        if self._advance is not None:
            self._advance.stop(why)

    def _no_other_advance(self, instead: str) -> None:
        """Raise Refused if an advance flies and nobody has stopped it."""
        if self._advance is not None and self._advance.stopped is None:
            goal = self._advance.goal
            where = "" if goal is None else f" to {goal * self._simulation.period:g} s"
            raise Refused(409, f"an advance{where} flies already; {instead}")

    async def _rewind(self, command: commands.Rewind) -> Done:
        """Go back to an earlier moment; the clock stops there, and so does an advance.

        Raises:
            CommandError: outside the flight; nothing has changed, and an advance flies on.
        """

        def back(simulation: Simulation) -> Done:
            self._still_there()
            before = simulation.epoch
            answer = simulation.do(not_past(command, simulation.now))
            self.stop_advance("rewound")
            # On the way out of the lock the clock must find itself stopped, so this is said here and not afterwards.
            if simulation.epoch < before or self._state == "failed":
                self._state, self.reason = "paused", None
            return Done(self.describe(simulation), answer)

        done = await self.read(back)
        now = done.state.clock.time
        if self.cursor is not None and self.cursor > now:
            self.cursor = None
        self.rewinds.append(now)
        for subscriber in self.subscribers:
            subscriber.rewound(now)
        self._publish(at_once=True)
        return done

    # ---- what there is to see -------------------------------------------------------------------------------------

    async def state(self) -> ExperimentState:
        """The experiment as it stands."""
        return await self.read(self.describe)

    def describe(self, simulation: Simulation) -> ExperimentState:
        """The experiment as it stands, for one who has the simulation."""
        scenario = simulation.scenario
        advancing = self._advance is not None and self._advance.flies(simulation.epoch) and self._state != "failed"
        return ExperimentState(
            id=self.id,
            title=self.title,
            system=self.description.id,
            seed=simulation.seed,
            scenario=ScenarioLabel(id=scenario.id, title=scenario.title, hint=scenario.hint),
            clock=ClockState(
                state="advancing" if advancing else self._state,
                time=simulation.now,
                epoch=simulation.epoch,
                period=simulation.period,
                speed=self._pacer.speed,
                duration=simulation.duration,
                reason=self.reason,
            ),
            faults=[shown(live) for live in simulation.faults],
            subsystems={
                name: SubsystemStatus.model_validate(status, from_attributes=True)
                for name, status in simulation.subsystems.items()
            },
            settings=simulation.settings,
            idle_settings=dict(simulation.idle_settings),
            unavailable=dict(simulation.unavailable),
            not_in_view=simulation.not_in_view,
            parent=self.parent,
            ghost_of=self.ghost_of,
            spare=self.reusable,
            watchers=self.attendance.watchers,
        )

    async def view(self) -> View:
        """Diagram and scene of the newest epoch; drawn up once for all who ask."""

        def look(simulation: Simulation) -> View:
            if self._view is None or self._view[0] != self.version:
                self._view = (self.version, simulation.view())
            return self._view[1]

        return await self.read(look)

    async def show(self, time: float | None, picture: str | None = None) -> None:
        """Move the scene's cursor to a past moment, or to the newest epoch (None), and choose one of its pictures.

        Raises:
            CommandError: outside the flight so far, or no such picture.
        """
        pictures = list(dict.fromkeys(item.picture for item in self.description.scene))
        if picture is not None and picture not in pictures:
            raise CommandError("picture", f"no picture {picture!r}; there are {', '.join(map(repr, pictures))}")

        def check(simulation: Simulation) -> None:
            if time is not None and time > simulation.now + 1e-9:
                raise CommandError(
                    "time", f"{time:g} s lies outside the flight so far, which is 0 to {simulation.now:g} s"
                )

        await self.read(check)
        self.cursor = time
        self.picture = self.picture if picture is None else picture
        for subscriber in self.subscribers:
            subscriber.changed(at_once=True)

    async def close(self) -> None:
        """Stop the clock and wait until nobody is at work on the simulation."""
        self.closed = True
        self.stop_advance("deleted")
        self._nudge.set()
        for subscriber in self.subscribers:
            subscriber.changed(at_once=True)
        if self._flight is not None:
            await self._flight
        await self._turns.settled()
