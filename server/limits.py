"""How much a request may send: refused when it says so, or when it turns out while the body streams in."""

from __future__ import annotations

from collections.abc import Mapping

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.problems import problem


class BodyLimit:
    """ASGI middleware: bodies of at most so many bytes, more at the paths that say so."""

    def __init__(self, app: ASGIApp, most: int, wider: Mapping[str, int]) -> None:
        self.app = app
        self.most = most
        self.wider = wider

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse what is said to be too large; count the rest as it comes."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        most = self.wider.get(scope["path"], self.most)
        declared = Headers(scope=scope).get("content-length", "0")
        if not declared.isdecimal() or int(declared) > most:
            await problem(413, f"the body is larger than the {most} bytes this server takes")(scope, receive, send)
            return
        received = 0

        async def counted() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > most:
                raise HTTPException(413)
            return message

        await self.app(scope, counted, send)
