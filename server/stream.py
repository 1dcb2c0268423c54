"""What a browser is sent while an experiment flies, and how a slow one is spared.

Nothing is queued. A viewer is a position in the recording; when it may be sent something it gets what is new since that
position, thinned to a bounded size by keeping extremes. At most :data:`CREDIT` unacknowledged frames are under way, so
one that lags gets fewer and newer frames, and the experiment never waits for anyone.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from bisect import bisect_left
from collections import deque
from typing import Any

import msgspec
from fastapi import WebSocket, WebSocketDisconnect

from ftcore import Simulation
from server.descriptions import signals_with_factors
from server.encoding import to_json
from server.experiments import Experiment
from server.limits import Budget
from server.models import ExperimentState
from server.series import Columns, columns, rows_for
from server.tasks import until_one_ends

CREDIT = 3
"""Unacknowledged frames before a viewer is left alone."""
INTERVAL = 0.05
"""Least time between two pushes [s]."""
MAX_SIGNALS = 500
MAX_EVENTS = 500
"""Most events in one push; a viewer further behind gets the newest, and reads the rest over REST."""
MAX_MESSAGE = 100_000
"""Longest message that a viewer may send [bytes]."""

MESSAGES_A_SECOND, MESSAGES_AT_ONCE = 50.0, 100
"""How many messages a viewer may send: in the long run (it acknowledges twenty frames a second), and in a burst."""

UNKNOWN, GONE, BAD_MESSAGE, BUSY, FLOOD, BROKEN = 4404, 4410, 4400, 4429, 1008, 1011
"""Close codes: no such experiment, it was deleted, a message that cannot be understood, too many streams, too many
messages, a defect."""

_log = logging.getLogger("ftlab")


class Subscribe(msgspec.Struct, tag="subscribe", tag_field="type", forbid_unknown_fields=True):
    """The viewer wants these signals from now on."""

    signals: list[str]


class Ack(msgspec.Struct, tag="ack", tag_field="type", forbid_unknown_fields=True):
    """The viewer has dealt with frames up to this time."""

    time: float


_decoder = msgspec.json.Decoder(Subscribe | Ack)


class Credit:
    """Counts the frames under way: sent, and not yet acknowledged."""

    def __init__(self) -> None:
        self._under_way: deque[float] = deque()

    @property
    def left(self) -> bool:
        """Whether another frame may be sent."""
        return len(self._under_way) < CREDIT

    def sent(self, last: float) -> None:
        """A frame that ends at time ``last`` was sent."""
        self._under_way.append(last)

    def acknowledged(self, time: float) -> None:
        """Frames up to the one that ends at ``time`` have arrived. Frames come in order, though time may go back."""
        if time in self._under_way:
            while self._under_way.popleft() != time:
                pass
        else:
            while self._under_way and self._under_way[0] <= time:
                self._under_way.popleft()


class Viewer:
    """One WebSocket that watches one experiment.

    Args:
        socket: accepted.
        experiment: what is watched.
        since: time up to which the client has everything; now if absent.
        history: how many rewinds the client knew of then, as its last ``hello`` or ``reset`` said.
    """

    def __init__(
        self, socket: WebSocket, experiment: Experiment, since: float | None = None, history: int | None = None
    ) -> None:
        self.socket = socket
        self.experiment = experiment
        self._news, self._command = asyncio.Event(), asyncio.Event()
        self._reset: float | None = None
        self._names: list[str] = []
        self._position = since
        self._history = history
        self._events = 0
        self._state: ExperimentState | None = None
        self._viewed = -1
        self._credit = Credit()
        self._budget = Budget(MESSAGES_A_SECOND, MESSAGES_AT_ONCE)

    # ---- what the experiment tells --------------------------------------------------------------------------------

    def changed(self, at_once: bool) -> None:
        """There is something new."""
        self._news.set()
        if at_once:
            self._command.set()

    def rewound(self, to: float) -> None:
        """Everything after ``to`` never happened."""
        self._reset = to if self._reset is None else min(to, self._reset)

    # ---- the two directions ---------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Serve the socket until either side has enough."""
        self.experiment.subscribers.add(self)
        try:
            with self.experiment.attendance.watched():
                errors = await until_one_ends(self._listen(), self._tell())
        finally:
            self.experiment.subscribers.discard(self)
        for error in errors:
            if not isinstance(error, WebSocketDisconnect | RuntimeError):
                _log.error("the stream of experiment %s broke", self.experiment.id, exc_info=error)
                with contextlib.suppress(WebSocketDisconnect, RuntimeError):
                    await self.socket.close(BROKEN, "this is a defect of FTLab")

    async def _listen(self) -> None:
        while True:
            message = await self.socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            if not self._budget.spend():
                await self.socket.close(FLOOD, f"more than {MESSAGES_A_SECOND:g} messages a second")
                return
            raw = message.get("text") or message.get("bytes") or b""
            try:
                if len(raw) > MAX_MESSAGE:
                    raise ValueError(f"a message of {len(raw)} bytes is too long")
                self._heard(_decoder.decode(raw))
            except ValueError as error:  # msgspec's errors are among them
                await self.socket.close(BAD_MESSAGE, str(error)[:120])
                return

    def _heard(self, message: Subscribe | Ack) -> None:
        match message:
            case Ack(time=time):
                self._credit.acknowledged(time)
            case Subscribe(signals=names):
                unknown = [name for name in names if name not in self.experiment.signals]
                if unknown or len(names) > MAX_SIGNALS:
                    raise ValueError(f"no signal {unknown[0]!r}" if unknown else f"at most {MAX_SIGNALS} signals")
                self._names = list(dict.fromkeys(names))  # of several between two frames the newest counts
        self._news.set()

    async def _tell(self) -> None:
        await self._greet()
        loop = asyncio.get_running_loop()
        next_frame = loop.time()
        while True:
            await self._news.wait()
            self._news.clear()
            self._command.clear()
            if self.experiment.closed:
                await self.socket.close(GONE, "the experiment was deleted")
                return
            now = loop.time()
            if now >= next_frame:
                next_frame = now + INTERVAL
                await self._push(frames=True)
            else:
                await self._push(frames=False)
                self._news.set()
            with contextlib.suppress(TimeoutError):
                # What someone did is told at once, what time brings when the next frame is due.
                await asyncio.wait_for(self._command.wait(), max(0.0, next_frame - loop.time()))

    async def _greet(self) -> None:
        def look(simulation: Simulation) -> tuple[ExperimentState, float, float | None, int]:
            since = simulation.now if self._position is None else self._position
            undone = [simulation.now] if since > simulation.now else []
            undone += self.experiment.rewinds[self._history :] if self._history is not None else []
            reset = min(undone) if undone and min(undone) < since else None
            since = since if reset is None else reset
            # Something may have been done at that very time after the client was cut off: better told twice than never.
            known = len(simulation.events) if self._position is None else events_before(simulation, since)
            return self.experiment.describe(simulation), since, reset, known

        state, self._position, reset, self._events = await self.experiment.read(look)
        self._state = state
        await self._send(
            {
                "type": "hello",
                "experiment": state.model_dump(mode="json"),
                "signals": signals_with_factors(self.experiment.description),
                "history": len(self.experiment.rewinds),
            }
        )
        if reset is not None:
            await self._say_reset(reset)
        self._news.set()

    async def _say_reset(self, time: float) -> None:
        await self._send({"type": "reset", "time": time, "history": len(self.experiment.rewinds)})

    async def _push(self, frames: bool) -> None:
        """Everything that is new and may be sent: reset, events, state, and frames and view if they are due."""
        reset, self._reset = self._reset, None
        if reset is not None:
            self._position = min(reset, self._position or 0.0)
            self._viewed = -1
            await self._say_reset(reset)
        wanted = frames and bool(self._names) and self._credit.left
        state, events, found = await self.experiment.read(lambda s: self._news_of(s, reset, wanted))
        for event in events:
            await self._send({"type": "event", **event})
        if found is not None and len(found.time):
            last = float(found.time[-1])
            self._position = last
            self._credit.sent(last)
            await self._send({"type": "frames", "time": found.time, "signals": found.signals})
        if not _same(state, self._state, counted=frames and self._credit.left):
            await self._send({"type": "state", **state.model_dump(mode="json")})
            self._state = state
        if frames and self._credit.left and self._viewed != self.experiment.version:
            self._viewed = self.experiment.version
            view = await self.experiment.view()
            await self._send({"type": "view", **view.model_dump(mode="json")})

    def _news_of(
        self, simulation: Simulation, reset: float | None, wants_frames: bool
    ) -> tuple[ExperimentState, list[dict[str, Any]], Columns | None]:
        """In a thread: what has come since the viewer's position."""
        if reset is not None:
            self._events = min(self._events, events_before(simulation, reset))
        new = simulation.events[self._events :]
        self._events = len(simulation.events)
        events = [event.model_dump(mode="json") for event in new[-MAX_EVENTS:]]
        frames = None
        if wants_frames:
            after = (self._position or 0.0) + 0.5 * simulation.period
            frames = columns(simulation, self._names, start=after, points=rows_for(len(self._names)))
        return self.experiment.describe(simulation), events, frames

    async def _send(self, message: dict[str, Any]) -> None:
        await self.socket.send_text(to_json(message).decode())


def events_before(simulation: Simulation, time: float) -> int:
    """How many events had happened before ``time``."""
    return bisect_left(simulation.events, time - 1e-9, key=lambda event: event.time)


def _same(new: ExperimentState, old: ExperimentState | None, counted: bool) -> bool:
    """Whether a viewer who follows the frames would learn nothing from the new state.

    A fault at work counts another epoch with every epoch; that is told to one who keeps up (``counted``).
    """
    if old is None:
        return False
    clock = old.clock.model_copy(update={"time": new.clock.time, "epoch": new.clock.epoch})
    same: dict[str, Any] = {"clock": clock}
    if not counted and len(new.faults) == len(old.faults):
        pairs = zip(old.faults, new.faults, strict=True)
        same["faults"] = [was.model_copy(update={"acted_epochs": now.acted_epochs}) for was, now in pairs]
    return new == old.model_copy(update=same)
