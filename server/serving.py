"""FTLab on a socket: uvicorn, with limits that it has not and an end that it does not know.

uvicorn closes an idle connection, but waits for ever for the rest of a request's head, and a browser's socket may send
it as many frames as it likes. At the end it cancels what still runs; FTLab tells those who wait before.
"""

from __future__ import annotations

import asyncio
import json
import socket
import sys
from collections.abc import Callable
from http import HTTPStatus
from typing import Any
from weakref import WeakKeyDictionary

import h11
import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from uvicorn.server import ServerState

from server.limits import Budget
from server.lingering import LingeringTransport

HEAD_SECONDS = 15.0
"""How long a connection may be open before the head of its next request is complete [s]."""
MOST_WAITING = 512
"""Connections without a request under way; one more, and the one that waits longest is closed."""
FRAMES_A_SECOND, FRAMES_AT_ONCE = 300.0, 600
"""How many frames a browser's socket may send, pings included: in the long run, and in a burst."""
PIECE = 4096
"""How much of what a socket sent is looked at in one go [bytes]; a frame has at least six."""
GOODBYE = 1.0
"""How long a socket that is sent away may take to hear why [s]."""
FAREWELL = 15.0
"""How long a socket may take to hear the rest when the application is done with it [s]."""
GRACE = 2
"""How long requests may still take when the server is stopped [s]."""

_waiting: WeakKeyDictionary[ServerState, dict[PatientHTTP, None]] = WeakKeyDictionary()


class PatientHTTP(H11Protocol):
    """uvicorn's HTTP connection, which is closed if no whole request head comes in time, whatever trickles in."""

    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start to wait for a request."""
        self._lingering = LingeringTransport(
            transport, self.loop, lambda: self.conn.their_state in (h11.SEND_BODY, h11.ERROR)
        )
        super().connection_made(self._lingering)  # type: ignore[arg-type]
        self._review()

    def connection_lost(self, exc: Exception | None) -> None:
        """Nobody is there any more."""
        self._wait_no_longer()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Something came; a whole head ends the waiting."""
        if self._lingering.lingers:
            self._lingering.throw_away(data)
            return
        super().data_received(data)
        self._review()

    def on_response_complete(self) -> None:
        """The next request is waited for; the rest of a body that nobody read does not count as one."""
        super().on_response_complete()
        self._review()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """From here on it is a browser's socket, which has limits of its own."""
        self._wait_no_longer()
        self.transport = self._lingering.real
        super().handle_websocket_upgrade(event)

    def send_400_response(self, msg: str) -> None:
        """What is no HTTP, or has a head that is too long, is told so as a problem like all others."""
        error = sys.exc_info()[1]
        status = error.error_status_hint if isinstance(error, h11.RemoteProtocolError) else 400
        detail = "this is not a request that can be read"
        if status == 431:
            detail = "the head of the request is too long"
            if b"\n" not in self.conn.trailing_data[0]:
                status, detail = 414, "the address is too long"
        body = json.dumps({"title": HTTPStatus(status).phrase, "status": status, "detail": detail}).encode()
        headers = [("content-type", "application/problem+json"), ("content-length", str(len(body)))]
        headers.append(("connection", "close"))
        answer = h11.Response(status_code=status, headers=headers, reason=HTTPStatus(status).phrase)
        for part in (answer, h11.Data(data=body), h11.EndOfMessage()):
            self.transport.write(self.conn.send(part) or b"")
        self.transport.close()

    def _review(self) -> None:
        """Wait for a request's head, or stop waiting for it."""
        under_way = self.cycle is not None and not self.cycle.response_complete
        if under_way or self.transport.is_closing() or self.transport.get_protocol() is not self:
            self._wait_no_longer()
        elif self._deadline is None:
            self._deadline = self.loop.call_later(HEAD_SECONDS, self._give_up)
            waiting = _waiting.setdefault(self.server_state, {})
            waiting[self] = None
            if len(waiting) > MOST_WAITING:
                next(iter(waiting))._give_up()

    def _give_up(self) -> None:
        """Hang up when what was answered has arrived; a client that does not read it is not waited for either."""
        self._wait_no_longer()
        self._lingering.real.close()
        self._drain(None)

    def shutdown(self) -> None:
        """The server is being stopped: whoever was answered and sent away is not waited for."""
        if self._lingering.lingers:
            self._lingering.real.abort()
        else:
            super().shutdown()

    def _drain(self, before: int | None) -> None:
        left = self.transport.get_write_buffer_size()
        if left and left == before:
            self.transport.abort()
        elif left:
            self.loop.call_later(HEAD_SECONDS, self._drain, left)

    def _wait_no_longer(self) -> None:
        _waiting.get(self.server_state, {}).pop(self, None)
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None


class MeasuredWebSocket(WebSocketsSansIOProtocol):
    """uvicorn's WebSocket, which is closed (1008) if it sends more frames than anyone needs."""

    def __init__(
        self,
        config: uvicorn.Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self._frames = Budget(FRAMES_A_SECOND, FRAMES_AT_ONCE, self.loop.time)
        self._dismissed = False

    def data_received(self, data: bytes) -> None:
        """Look at what came piece by piece, so that a chunk of tiny frames costs no more than the budget."""
        for start in range(0, len(data), PIECE):
            if self._dismissed or self.transport.is_closing():
                return
            super().data_received(data[start : start + PIECE])

    def handle_events(self) -> None:
        """Deal with the frames that came, if there are not too many."""
        if self._frames.spend(len(self.conn.events)) or not self.handshake_complete:
            super().handle_events()
        else:
            self._dismiss(1008, "too many messages")

    def send_receive_event_to_app(self) -> None:
        """A text that is no UTF-8 ends the socket; uvicorn would print a traceback for each."""
        if self.curr_msg_data_type == "text":
            try:
                b"".join(self.frames).decode()
            except UnicodeDecodeError:
                self._dismiss(1007, "not UTF-8")
                return
        super().send_receive_event_to_app()

    def _dismiss(self, code: int, reason: str) -> None:
        """Say why, read no more, and hang up a little later: at once, the reason would be lost with what is unread."""
        self._dismissed = True
        if not self.close_sent:
            self.close_sent = True
            self.queue.put_nowait({"type": "websocket.disconnect", "code": code, "reason": reason})
            self.conn.send_close(code, reason)
            self.transport.write(b"".join(self.conn.data_to_send()))
        self.transport.pause_reading()
        self.read_paused = True
        if self.close_timer is not None:
            self.close_timer.cancel()
        self.close_timer = self.loop.call_later(GOODBYE, self.transport.abort)

    def keepalive_timeout(self) -> None:
        """A browser that answers no ping does not read either: what waits for it would wait for ever."""
        super().keepalive_timeout()
        self.loop.call_later(GOODBYE, self.transport.abort)

    def on_task_complete(self, task: asyncio.Task[None]) -> None:
        """The application is done with it; whoever does not hang up is hung up on."""
        super().on_task_complete(task)
        self.loop.call_later(FAREWELL, self.transport.abort)

    async def receive(self) -> Any:
        """The next message for the application; a socket that was sent away is not read again."""
        message = await self.queue.get()
        if self.read_paused and self.queue.empty() and not self._dismissed:
            self.read_paused = False
            self.transport.resume_reading()
        return message


class Server(uvicorn.Server):
    """uvicorn's server, which tells the application before it waits for requests to end.

    Args:
        config: with the application loaded by the caller.
        leaving: called once when the server begins to stop.
    """

    def __init__(self, config: uvicorn.Config, leaving: Callable[[], None]) -> None:
        super().__init__(config)
        self._leaving = leaving

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Stop: whoever waits for something long is answered first."""
        self._leaving()
        await super().shutdown(sockets)


def server_of(app: FastAPI, grace: float = GRACE) -> Server:
    """A server for the application, not yet running; give it sockets to listen on.

    Args:
        app: made by :func:`server.app.create_app`.
        grace: how long requests may still take when it is stopped [s].
    """
    config = uvicorn.Config(
        app,
        http=PatientHTTP,
        ws=MeasuredWebSocket,
        ws_per_message_deflate=False,
        ws_max_size=256 * 1024,
        log_level="warning",
        proxy_headers=False,
        server_header=False,
        timeout_graceful_shutdown=grace,  # type: ignore[arg-type]
    )
    return Server(config, lambda: app.state.registry.leave())
