"""Two coroutines that belong together, such as the two directions of a socket."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any


async def until_one_ends(*ways: Coroutine[Any, Any, None]) -> list[BaseException]:
    """Run all until one ends, then cancel the rest. Returns what went wrong in those that ended by themselves."""
    tasks = [asyncio.ensure_future(way) for way in ways]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        return [error for task in done if (error := task.exception()) is not None]
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
