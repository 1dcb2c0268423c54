"""Large JSON bodies, read beside the event loop."""

from __future__ import annotations

import asyncio
import json
import json.scanner
from collections.abc import Callable, Coroutine
from typing import Any

from fastapi.routing import APIRoute
from starlette.requests import Request
from starlette.responses import Response

from server.limits import SMALL_BODY


class _Scanner(json.JSONDecoder):
    """Python's JSON decoder without its C scanner: that keeps all threads waiting until it has read the whole body."""

    def __init__(self) -> None:
        super().__init__()
        self.scan_once = json.scanner.py_make_scanner(self)  # type: ignore[attr-defined]


def parse(body: bytes) -> Any:
    """What a JSON body says, read in small steps between which other threads run; for bodies of megabytes.

    Raises:
        ValueError: not JSON, or not text.
    """
    return _Scanner().decode(body.decode(json.detect_encoding(body), "surrogatepass"))


class _LargeRequest(Request):
    """A request whose JSON body is parsed in a thread if it is large."""

    async def json(self) -> Any:
        """The body. Raises ValueError if it is not JSON."""
        body = await self.body()
        if len(body) <= SMALL_BODY:
            return await super().json()
        return await asyncio.to_thread(parse, body)


class LargeBodies(APIRoute):
    """A route that takes large JSON bodies and leaves the event loop to others while it reads one."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler of FastAPI, with a request that parses in a thread."""
        handle = super().get_route_handler()

        async def handler(request: Request) -> Response:
            return await handle(_LargeRequest(request.scope, request.receive))

        return handler
