"""The job of an advance: one flight to a goal, as fast as it goes, which whoever must can stop between two epochs.

It is a value apart from the request that asked for it, so that a clock that is paused, a rewind, a deletion, the end of
the server and a client that hangs up all stop it in the same way.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import Literal

from fastapi import Request

from server.problems import Refused, at

Stop = Literal["paused", "rewound", "deleted", "leaving", "gone"]
"""Why an advance ends before its goal: the clock was paused, the flight rewound, the experiment deleted, the server is
being stopped, or the client that asked has gone."""

_ANSWERS: dict[Stop, tuple[int, str]] = {
    "paused": (409, "the clock was paused at {now:g} s, before the goal at {goal:g} s; ask again for the rest"),
    "rewound": (409, "the flight was rewound while this advance flew; its goal was {goal:g} s"),
    "deleted": (410, "the experiment was deleted while this advance flew, at {now:g} s of {goal:g} s"),
    "leaving": (503, "the server is being stopped; this advance ended at {now:g} s of {goal:g} s"),
    "gone": (409, "the client hung up at {now:g} s, before the goal at {goal:g} s"),
}


class Job:
    """One flight to a goal. Lives on the event loop; a worker looks at ``stopped`` before each epoch.

    Args:
        most: epochs that it may fly; None: any number.

    Attributes:
        goal: epoch to reach; None until the simulation has been asked.
        stopped: why it ends before its goal; None as long as it may fly on.
    """

    def __init__(self, most: int | None = None) -> None:
        self.most = most
        self.goal: int | None = None
        self.stopped: Stop | None = None

    def stop(self, why: Stop) -> None:
        """End it after the epoch that is under way. The first reason counts."""
        self.stopped = self.stopped or why

    def refuse_more(self, epochs: int, field: str) -> None:
        """Raise Refused if ``epochs`` are more than one advance may fly; ``field`` is the one that asks for them."""
        if self.most is not None and epochs > self.most:
            text = f"one advance flies at most {self.most} epochs; ask again for the rest"
            raise Refused(409, text, [at([field], text)])

    def flies(self, epoch: int) -> bool:
        """Whether there is something left to fly for a flight that is at ``epoch``."""
        return self.stopped is None and self.goal is not None and epoch < self.goal

    def refusal(self, epoch: int, period: float) -> Refused:
        """What the client that asked is told when the goal was not reached.

        Args:
            epoch: where the flight stands.
            period: seconds between epochs.
        """
        status, text = _ANSWERS[self.stopped or "paused"]
        return Refused(status, text.format(now=epoch * period, goal=(self.goal or 0) * period))


@contextlib.asynccontextmanager
async def for_as_long_as_the_client_listens(request: Request, most: int | None = None) -> AsyncIterator[Job]:
    """A job that is stopped when the client of ``request`` hangs up. The request's body must have been read."""
    job = Job(most)

    async def watch() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass
        job.stop("gone")

    watching = asyncio.create_task(watch())
    try:
        yield job
    finally:
        watching.cancel()
        await asyncio.wait([watching])
