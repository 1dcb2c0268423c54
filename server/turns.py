"""Who has a simulation now: a simulation takes one caller at a time, and all work on it is done in threads."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from concurrent.futures import Executor
from typing import Any, TypeVar

from server.pacing import Clock

T = TypeVar("T")


class Workers:
    """Threads that fly, the fair queue for them, and the clock that they fly by."""

    def __init__(self, executor: Executor, threads: int, clock: Clock) -> None:
        self.executor = executor
        self.clock = clock
        self.turns = asyncio.Semaphore(threads)


class Turns:
    """The turns at one simulation. Lives on the event loop; whoever comes first has it first.

    Args:
        workers: the threads that fly.
    """

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._lock = asyncio.Lock()
        self._busy: set[asyncio.Task[Any]] = set()

    async def alone(self, work: Callable[[], T]) -> T:
        """Do ``work`` in a thread while nobody else has the simulation.

        A caller that gives up does not open the lock under a thread at work.
        """
        return await self._locked(lambda: asyncio.to_thread(work))

    async def fly(self, slice: Callable[[], None]) -> None:
        """Fly one slice in a worker, after all who wait for the simulation now."""
        async with self._lock:
            pass  # whoever waits for the simulation goes first, and no worker idles meanwhile
        async with self._workers.turns:
            loop = asyncio.get_running_loop()
            await self._locked(lambda: loop.run_in_executor(self._workers.executor, slice))

    @property
    def taken(self) -> int:
        """Callers that have the simulation or wait for it."""
        return len(self._busy)

    async def settled(self) -> None:
        """Wait until nobody is at work on the simulation."""
        await asyncio.gather(*self._busy, return_exceptions=True)

    async def _locked(self, work: Callable[[], Awaitable[T]]) -> T:
        async def locked() -> T:
            async with self._lock:
                return await work()

        task = asyncio.ensure_future(locked())
        self._busy.add(task)
        task.add_done_callback(self._done)
        return await asyncio.shield(task)

    def _done(self, task: asyncio.Task[Any]) -> None:
        self._busy.discard(task)
        if not task.cancelled():
            task.exception()  # whoever waited has it; whoever gave up does not want it
