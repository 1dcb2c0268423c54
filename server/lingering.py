"""A connection's end that reaches a client which is still sending."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

LINGER = 5.0
"""How long a client may go on sending after it was answered and sent away [s]."""
MOST_UNREAD = 256_000_000
"""How much it may send meanwhile [bytes]; all of it is thrown away."""


class LingeringTransport:
    """A transport whose ``close`` waits for a client that is still sending.

    If a socket is closed while something that came is unread, the other side is told "connection reset" and loses the
    answer that was on its way. So the answer's end is sent, and what still comes is read and thrown away for a while.

    Args:
        transport: the real one.
        loop: what counts the time.
        sending: whether the client is in the middle of a request.
    """

    def __init__(
        self, transport: asyncio.Transport, loop: asyncio.AbstractEventLoop, sending: Callable[[], bool]
    ) -> None:
        self.real = transport
        self._loop, self._sending = loop, sending
        self._unread: int | None = None

    def __getattr__(self, name: str) -> Any:
        """Everything else is as the real transport has it."""
        return getattr(self.real, name)

    @property
    def lingers(self) -> bool:
        """Whether what comes is thrown away."""
        return self._unread is not None

    def is_closing(self) -> bool:
        """Whether it is closed, or about to be."""
        return self.lingers or self.real.is_closing()

    def close(self) -> None:
        """Send what is to be sent, and close: at once, or when a client that is still sending has done so."""
        if self.is_closing():
            return
        if not self._sending() or not self.real.can_write_eof():
            self.real.close()
            return
        self._unread = 0
        self.real.write_eof()
        self.real.resume_reading()
        self._loop.call_later(LINGER, self.real.abort)

    def throw_away(self, data: bytes) -> None:
        """Take what came after the end; hang up if it is too much."""
        self._unread = (self._unread or 0) + len(data)
        if self._unread > MOST_UNREAD:
            self.real.abort()
