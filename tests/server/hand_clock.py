"""A clock that a test moves by hand, and a registry of experiments that fly by it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

from server.experiments import Experiment
from server.pacing import Clock
from server.registry import ExperimentRegistry
from server.settings import Settings
from server.uploads import Uploads


class HandClock(Clock):
    """Stands still but for what a test moves it by.

    Args:
        tick: what every look at it costs [s], so that a slice of flight ends after a known number of epochs.
    """

    def __init__(self, tick: float = 0.0) -> None:
        self.time = 1000.0
        self.tick = tick
        self._waiting: dict[asyncio.Event, float] = {}

    def now(self) -> float:
        self.time += self.tick
        return self.time

    async def happens_within(self, event: asyncio.Event, seconds: float) -> bool:
        end = self.time + seconds
        self._waiting[event] = end
        try:
            while not event.is_set() and self.time < end - 1e-9:
                await asyncio.sleep(0)
            return event.is_set()
        finally:
            del self._waiting[event]

    async def move(self, seconds: float, flying: list[Experiment]) -> None:
        """Let so much time go by [s], and wait until every one of ``flying`` has flown what was due in it."""
        self.time += seconds
        await self.settled(flying)

    async def settled(self, flying: list[Experiment]) -> None:
        """Wait until every one of ``flying`` waits for its next epoch, which is not due yet."""
        while not all(self._waiting.get(e._nudge, -1.0) > self.time + 1e-9 for e in flying):
            await asyncio.sleep(0)


@contextlib.asynccontextmanager
async def laboratory(clock: Clock) -> AsyncIterator[ExperimentRegistry]:
    """Experiments without a network, flown by ``clock``."""
    settings = Settings(workers=2)
    uploads = Uploads(1000)
    registry = ExperimentRegistry(settings, uploads, clock)
    try:
        yield registry
    finally:
        await registry.close()
        uploads.close()
