"""What one client may ask of the server: bytes, time, messages, sockets, and wrong tokens."""

from __future__ import annotations

import asyncio
import ipaddress
import math
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.problems import problem

Clock = Callable[[], float]

DOCUMENT_PATH = "/api/v1/experiments"
"""Where whole scenarios come in."""
SMALL_BODY = 64_000
"""Largest body of everything else that is no upload [bytes]: a command says what it says in less."""
BODY_SECONDS, BODY_RATE = 20.0, 10_000.0
"""A body has this long [s], and longer by what has come of it at this rate [bytes/s]."""


class Budget:
    """How often something may happen: so often a second in the long run, and so many at once.

    Args:
        rate: a second.
        burst: at once, after a pause.
        clock: seconds, never going back.
    """

    def __init__(self, rate: float, burst: int, clock: Clock = time.monotonic) -> None:
        self._rate, self._burst, self._clock = rate, float(burst), clock
        self._left, self._at = self._burst, clock()

    def spend(self, number: int = 1) -> bool:
        """Take so many from the budget; False if there are not so many left, and then none is taken."""
        now = self._clock()
        self._left, self._at = min(self._burst, self._left + (now - self._at) * self._rate), now
        if number > self._left:
            return False
        self._left -= number
        return True


class BodyLimit:
    """ASGI middleware: bodies of at most so many bytes, more at the paths that say so, and none that stalls."""

    def __init__(self, app: ASGIApp, most: int, wider: Mapping[str, int], seconds: float = BODY_SECONDS) -> None:
        self.app = app
        self.most = most
        self.wider = wider
        self.seconds = seconds

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse what is said to be too large; count the rest as it comes."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        most = self.wider.get(scope["path"], self.most)
        declared = Headers(scope=scope).get("content-length", "0")
        if not (declared.isascii() and declared.isdecimal()) or int(declared[:20]) > most:
            answer = problem(413, f"the body is larger than the {most} bytes this server takes")
            await answer(scope, receive, send)
            return
        received, whole, begun = 0, False, time.monotonic()

        async def counted() -> Message:
            nonlocal received, whole
            if whole:
                return await receive()
            left = self.seconds + received / BODY_RATE - (time.monotonic() - begun)
            try:
                async with asyncio.timeout(max(0.0, left)):
                    message = await receive()
            except TimeoutError:
                raise HTTPException(408, headers={"connection": "close"}) from None
            received += len(message.get("body", b""))
            whole = not message.get("more_body", False)
            if received > most:
                raise HTTPException(413, headers={"connection": "close"})
            return message

        await self.app(scope, counted, send)


class Answered:
    """ASGI middleware: a request that is cancelled because the server stops is answered (503) and not just dropped.

    Args:
        leaving: whether the server is being stopped.
    """

    def __init__(self, app: ASGIApp, leaving: Callable[[], bool]) -> None:
        self.app = app
        self.leaving = leaving

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on; answer what is cut off."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        started = False

        async def noted(message: Message) -> None:
            nonlocal started
            started = True
            await send(message)

        try:
            await self.app(scope, receive, noted)
        except asyncio.CancelledError:
            if started or not self.leaving():
                raise
            answer = problem(503, "the server is being stopped")
            await answer(scope, receive, send)


class SocketLimit:
    """ASGI middleware: at most so many WebSockets of one client at the same time; one more is told 4429."""

    def __init__(self, app: ASGIApp, most: int) -> None:
        self.app = app
        self.most = most
        self._open: Counter[str] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let through, counted, or send away."""
        if scope["type"] != "websocket":
            await self.app(scope, receive, send)
            return
        client = client_of(scope)
        if self._open[client] >= self.most:
            await receive()
            await send({"type": "websocket.accept"})
            await send({"type": "websocket.close", "code": 4429, "reason": f"{self.most} sockets of yours are open"})
            return
        self._open[client] += 1
        try:
            await self.app(scope, receive, send)
        finally:
            self._open[client] -= 1
            if not self._open[client]:
                del self._open[client]


class Patience:
    """How long a client that has tried wrong tokens must wait before its next try counts.

    The first few are free; then each doubles the wait, up to a limit. A client that is quiet long enough begins anew.
    Nobody else waits: the count is by address (IPv6: by network, since one client has many addresses).

    Args:
        clock: seconds, never going back.
    """

    FREE = 5
    LONGEST = 60.0
    FORGOTTEN = 600.0
    REMEMBERED = 10_000
    """Clients that are remembered at most; then the one that tried longest ago is forgotten."""

    def __init__(self, clock: Clock = time.monotonic) -> None:
        self._clock = clock
        self._tries: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def wait(self, client: str) -> float:
        """Seconds until the next try of a client counts; 0 if it may try now."""
        wrong, at = self._tries.get(client, (0, 0.0))
        if wrong < self.FREE:
            return 0.0
        return max(0.0, at + min(self.LONGEST, 2.0 ** (wrong - self.FREE)) - self._clock())

    def failed(self, client: str) -> None:
        """A try was wrong."""
        now = self._clock()
        wrong, at = self._tries.pop(client, (0, now))
        wrong = 0 if now - at > self.FORGOTTEN else wrong
        self._tries[client] = (min(wrong + 1, 60), now)
        if len(self._tries) > self.REMEMBERED:
            self._tries.popitem(last=False)

    def succeeded(self, client: str) -> None:
        """A try was right: what went before is forgotten."""
        self._tries.pop(client, None)


def client_of(scope: Scope) -> str:
    """Whom limits are counted for: the address that a request comes from; of IPv6 its network of 64 bits."""
    host = scope["client"][0] if scope.get("client") else ""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return str(host)
    if isinstance(address, ipaddress.IPv6Address):
        return str(address.ipv4_mapped or ipaddress.IPv6Network((int(address), 64), strict=False))
    return str(address)


def whole_seconds(seconds: float) -> str:
    """For Retry-After: never so few that the next try comes too soon."""
    return str(max(1, math.ceil(seconds)))
