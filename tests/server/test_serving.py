"""Connections that trickle, stall or flood, by a clock of the test's own."""

from __future__ import annotations

import asyncio
import functools
import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import uvicorn
from fastapi import FastAPI, Request
from fastapi.testclient import TestClient
from uvicorn.server import ServerState
from websockets.client import ClientProtocol
from websockets.frames import Frame, Opcode
from websockets.uri import parse_uri

from server import lingering, problems, serving
from server.limits import BodyLimit, Budget, SocketLimit
from server.lingering import LINGER
from server.serving import FRAMES_AT_ONCE, HEAD_SECONDS, MeasuredWebSocket, PatientHTTP


class Loop:
    """What a connection needs of an event loop; time goes by when the test says so."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.now = 0.0
        self._loop = loop
        self._due: list[tuple[float, Callable[[], None], list[bool]]] = []
        self.create_task = loop.create_task

    def time(self) -> float:
        return self.now

    def call_later(self, delay: float, call: Callable[..., None], *arguments: Any) -> Any:
        cancelled: list[bool] = []
        self._due.append((self.now + delay, functools.partial(call, *arguments), cancelled))

        class Handle:
            def cancel(self) -> None:
                cancelled.append(True)

        return Handle()

    def wait(self, seconds: float) -> None:
        self.now += seconds
        due, self._due = [d for d in self._due if d[0] <= self.now], [d for d in self._due if d[0] > self.now]
        for _, call, cancelled in due:
            if not cancelled:
                call()
        self.turn()

    def turn(self) -> None:
        """Let whatever can go on go on."""
        self._loop.run_until_complete(asyncio.sleep(0.0))
        self._loop.run_until_complete(asyncio.sleep(0.0))


class Wire:
    """A transport that remembers."""

    def __init__(self) -> None:
        self.sent, self.closed, self.paused, self.aborted, self.unread = b"", False, False, False, 0
        self.ended = False
        self.protocol: Any = None

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        return {"sockname": ("127.0.0.1", 8000), "peername": ("127.0.0.1", 5000)}.get(name, default)

    def write(self, data: bytes) -> None:
        self.sent += data

    def close(self) -> None:
        self.closed = True

    def abort(self) -> None:
        self.closed = self.aborted = True

    def can_write_eof(self) -> bool:
        return True

    def write_eof(self) -> None:
        self.ended = True

    def get_write_buffer_size(self) -> int:
        return self.unread

    def is_closing(self) -> bool:
        return self.closed

    def pause_reading(self) -> None:
        self.paused = True

    def resume_reading(self) -> None:
        self.paused = False

    def set_protocol(self, protocol: Any) -> None:
        self.protocol = protocol

    def get_protocol(self) -> Any:
        return self.protocol


class Connection:
    """A client's connection to an application."""

    def __init__(self, loop: Loop, state: ServerState, app: Any) -> None:
        config = uvicorn.Config(app, http=PatientHTTP, ws=MeasuredWebSocket, lifespan="off", log_level="critical")
        config.load()
        config.loaded_app = app
        config.ws_protocol_class = functools.partial(MeasuredWebSocket, _loop=loop)  # type: ignore[assignment,arg-type]
        self.loop, self.wire = loop, Wire()
        self.http = PatientHTTP(config, state, {}, loop)  # type: ignore[arg-type]
        self.wire.protocol = self.http
        self.http.connection_made(self.wire)  # type: ignore[arg-type]

    def say(self, data: bytes) -> None:
        self.wire.protocol.data_received(data)
        self.loop.turn()


async def hello(scope: Any, receive: Any, send: Any) -> None:
    """Answers at once, whatever of the body has come."""
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"2")]})
    await send({"type": "http.response.body", "body": b"hi"})


@pytest.fixture
def loop(monkeypatch: pytest.MonkeyPatch) -> Iterator[Loop]:
    real = asyncio.new_event_loop()
    asyncio.set_event_loop(real)
    yield Loop(real)
    left = asyncio.all_tasks(real)
    for task in left:
        task.cancel()
    real.run_until_complete(asyncio.wait(left) if left else asyncio.sleep(0.0))
    real.close()
    asyncio.set_event_loop(None)


@pytest.fixture
def connect(loop: Loop) -> Callable[..., Connection]:
    state = ServerState()
    return lambda app=hello: Connection(loop, state, app)


HEAD = b"GET / HTTP/1.1\r\nhost: x\r\n\r\n"


@pytest.mark.parametrize("begun", [b"", b"GET / HT", b"GET / HTTP/1.1\r\nhost: x\r\n"])
def test_a_connection_whose_next_head_never_comes_is_closed(
    connect: Callable[..., Connection], loop: Loop, begun: bytes
) -> None:
    connection = connect()
    connection.say(begun) if begun else None
    loop.wait(HEAD_SECONDS - 0.1)
    assert not connection.wire.closed
    loop.wait(0.2)
    assert connection.wire.closed


def test_what_trickles_in_does_not_lengthen_the_wait(connect: Callable[..., Connection], loop: Loop) -> None:
    connection, said = connect(), 0
    while not connection.wire.closed:
        connection.say(b"GET /" + b"x" * 100 if said == 0 else b"x")
        said += 1
        loop.wait(1.0)
    assert said == HEAD_SECONDS


def test_a_body_that_nobody_reads_does_not_keep_a_connection(connect: Callable[..., Connection], loop: Loop) -> None:
    connection = connect()
    connection.say(b"POST / HTTP/1.1\r\nhost: x\r\ncontent-length: 1000\r\n\r\n")
    assert connection.wire.sent.endswith(b"hi")
    said = 0
    while not connection.wire.closed:
        connection.say(b"x")
        said += 1
        loop.wait(1.0)
    assert said == HEAD_SECONDS


def test_a_request_under_way_takes_as_long_as_it_takes_and_many_may_follow(
    connect: Callable[..., Connection], loop: Loop
) -> None:
    answer = asyncio.Event()

    async def slow(scope: Any, receive: Any, send: Any) -> None:
        await answer.wait()
        await hello(scope, receive, send)

    connection = connect(slow)
    connection.say(HEAD)
    loop.wait(3600.0)
    assert not connection.wire.closed
    answer.set()
    loop.turn()
    for _ in range(10):
        loop.wait(4.0)
        connection.say(HEAD)
    assert connection.wire.sent.count(b"200") == 11
    assert not connection.wire.closed


def test_a_slow_client_gets_all_of_its_answer_and_one_that_does_not_read_is_hung_up_on(
    connect: Callable[..., Connection], loop: Loop
) -> None:
    slow, deaf = connect(), connect()
    for connection in (slow, deaf):
        connection.say(HEAD)
        connection.wire.unread = 17_000_000
    for _ in range(100):
        slow.wire.unread -= 100_000
        loop.wait(HEAD_SECONDS)
    assert (slow.wire.closed, slow.wire.aborted) == (True, False)
    assert deaf.wire.aborted


def test_of_too_many_connections_that_wait_the_longest_is_closed(
    connect: Callable[..., Connection], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serving, "MOST_WAITING", 3)
    first, second, *others = [connect() for _ in range(4)]
    assert [c.wire.closed for c in (first, second, *others)] == [True, False, False, False]
    second.say(b"GET")
    connect()
    assert second.wire.closed


@pytest.mark.parametrize(
    ("head", "status"),
    [(b"NONSENSE\r\n\r\n", 400), (b"GET /" + b"x" * 100_000, 414), (HEAD[:-2] + b"a: " + b"x" * 100_000, 431)],
)
def test_what_is_no_request_is_told_so_as_a_problem(
    connect: Callable[..., Connection], loop: Loop, head: bytes, status: int
) -> None:
    connection = connect()
    connection.say(head)
    answer, _, body = connection.wire.sent.partition(b"\r\n\r\n")
    assert answer.startswith(f"HTTP/1.1 {status} ".encode())
    assert b"application/problem+json" in answer
    assert json.loads(body)["status"] == status
    assert connection.wire.ended
    loop.wait(LINGER)
    assert connection.wire.closed


LONG_HEAD = b"GET /" + b"x" * 400_000 + b" HTTP/1.1\r\nhost: x\r\n\r\n"
LONG_BODY = b"POST / HTTP/1.1\r\nhost: x\r\ncontent-length: 400000\r\n\r\n" + b"x" * 400_000


async def turned_away(scope: Any, receive: Any, send: Any) -> None:
    """Answers at once and wants no more."""
    head = [(b"content-length", b"2"), (b"connection", b"close")]
    await send({"type": "http.response.start", "status": 413, "headers": head})
    await send({"type": "http.response.body", "body": b"no"})


@pytest.mark.parametrize(("request_", "status"), [(LONG_HEAD, 414), (LONG_BODY, 413)])
def test_a_client_that_is_still_sending_hears_the_answer_before_the_connection_is_closed(
    connect: Callable[..., Connection], loop: Loop, request_: bytes, status: int
) -> None:
    connection = connect(turned_away)
    for start in range(0, len(request_), 50_000):
        assert not connection.wire.closed
        connection.say(request_[start : start + 50_000])
    assert connection.wire.sent.count(b"HTTP/1.1 ") == 1
    assert connection.wire.sent.startswith(f"HTTP/1.1 {status} ".encode())
    assert connection.wire.ended
    loop.wait(LINGER)
    assert connection.wire.closed


def test_a_client_that_pours_on_after_its_answer_is_hung_up_on(
    connect: Callable[..., Connection], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lingering, "MOST_UNREAD", 200_000)
    connection = connect(turned_away)
    connection.say(LONG_HEAD[:100_000])
    assert not connection.wire.closed
    connection.say(b"x" * 200_001)
    assert connection.wire.aborted


# ---- sockets ------------------------------------------------------------------------------------------------------


class Listener:
    """An application that takes a socket and notes what it hears."""

    def __init__(self) -> None:
        self.heard: list[Any] = []

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        while True:
            message = await receive()
            self.heard.append(message)
            if message["type"] == "websocket.connect":
                await send({"type": "websocket.accept"})
            if message["type"] == "websocket.disconnect":
                return


class Browser:
    """A client's WebSocket over a connection."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.ws = ClientProtocol(parse_uri("ws://127.0.0.1:8000/"))
        self.ws.send_request(self.ws.connect())
        connection.say(b"".join(self.ws.data_to_send()))

    def send(self, *frames: Frame) -> None:
        """All frames in one chunk, as a network brings them."""
        self.connection.say(b"".join(frame.serialize(mask=True) for frame in frames))

    @property
    def told(self) -> tuple[int, str] | None:
        """Why it was sent away."""
        self.ws.receive_data(self.connection.wire.sent)
        self.connection.wire.sent = b""
        return (self.ws.close_rcvd.code, self.ws.close_rcvd.reason) if self.ws.close_rcvd else None


TEXT, PING = Frame(Opcode.TEXT, b"{}"), Frame(Opcode.PING, b"")
MORE = Frame(Opcode.CONT, b"", fin=False)


def test_a_socket_that_floods_on_after_the_application_closed_it_is_not_read_to_the_end(
    connect: Callable[..., Connection], loop: Loop
) -> None:
    async def refuses(scope: Any, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        await send({"type": "websocket.close", "code": 4400, "reason": "no"})

    browser = Browser(connect(refuses))
    loop.turn()
    browser.send(*[TEXT] * 20_000)
    assert browser.told == (4400, "no")
    assert browser.connection.wire.paused
    loop.wait(serving.GOODBYE)
    assert browser.connection.wire.closed


@pytest.mark.parametrize(
    "flood", [[TEXT], [PING], [Frame(Opcode.PONG, b"")], [Frame(Opcode.TEXT, b"", fin=False), MORE]]
)
def test_a_socket_that_floods_is_closed_and_costs_no_more_than_its_budget(
    connect: Callable[..., Connection], loop: Loop, flood: list[Frame]
) -> None:
    app = Listener()
    browser = Browser(connect(app))
    loop.turn()
    browser.send(*flood, *[flood[-1]] * 20_000)
    for _ in range(FRAMES_AT_ONCE + 10):
        loop.turn()
    assert browser.told == (1008, "too many messages")
    assert len(app.heard) <= FRAMES_AT_ONCE + 2
    assert app.heard[-1]["type"] == "websocket.disconnect"
    assert browser.connection.wire.paused
    loop.wait(serving.GOODBYE)
    assert browser.connection.wire.closed


def test_a_socket_may_send_as_many_as_anyone_needs(connect: Callable[..., Connection], loop: Loop) -> None:
    app = Listener()
    browser = Browser(connect(app))
    for _ in range(20):
        browser.send(*[TEXT] * 200)
        loop.wait(1.0)
        for _ in range(200):
            loop.turn()
    assert browser.told is None
    assert len(app.heard) == 1 + 20 * 200


def test_a_socket_that_reads_nothing_is_hung_up_on(connect: Callable[..., Connection], loop: Loop) -> None:
    browser = Browser(connect(Listener()))
    browser.connection.wire.protocol.pause_writing()
    loop.wait(20.0)  # a ping
    loop.wait(20.0)  # and no answer
    loop.wait(serving.GOODBYE)
    assert browser.connection.wire.aborted


def test_a_socket_that_does_not_hang_up_is_hung_up_on(connect: Callable[..., Connection], loop: Loop) -> None:
    async def leaves(scope: Any, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "websocket.accept"})

    browser = Browser(connect(leaves))
    loop.turn()
    loop.wait(serving.FAREWELL)
    assert browser.connection.wire.aborted


def test_a_text_that_is_none_ends_the_socket_quietly(
    connect: Callable[..., Connection], capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    browser = Browser(connect(Listener()))
    browser.send(Frame(Opcode.TEXT, b"\xff\xfe"))
    assert browser.told == (1007, "not UTF-8")
    assert not caplog.records
    assert capsys.readouterr() == ("", "")


def test_a_budget_is_so_many_at_once_and_so_many_a_second() -> None:
    now = [0.0]
    budget = Budget(10.0, 5, lambda: now[0])
    assert [budget.spend() for _ in range(6)] == [True] * 5 + [False]
    now[0] = 0.25
    assert [budget.spend() for _ in range(3)] == [True, True, False]
    now[0] = 100.0
    assert not budget.spend(6)
    assert budget.spend(5)


# ---- bodies and numbers of sockets --------------------------------------------------------------------------------


def test_an_upload_that_stalls_is_answered_408_and_hung_up_on() -> None:
    application = FastAPI()
    problems.install(application)

    @application.post("/")
    async def take(request: Request) -> int:
        return len(await request.body())

    async def stalls(scope: Any, receive: Any, send: Any) -> None:
        async def never() -> Any:
            await asyncio.Event().wait()

        await BodyLimit(application, 1000, {}, seconds=0.0)(scope, never if scope["type"] == "http" else receive, send)

    answer = TestClient(stalls).post("/", content=b"x")
    assert (answer.status_code, answer.headers["connection"]) == (408, "close")
    assert answer.headers["content-type"] == "application/problem+json"


def test_one_client_has_so_many_sockets_and_another_its_own() -> None:
    entered: list[str] = []

    async def scenario() -> list[Any]:
        go = asyncio.Event()

        async def app(scope: Any, receive: Any, send: Any) -> None:
            entered.append(scope["client"][0])
            await go.wait()

        limit, told = SocketLimit(app, 2), []

        async def nothing() -> Any:
            return {"type": "websocket.connect"}

        async def note(message: Any) -> None:
            told.append(message)

        def open_for(host: str) -> asyncio.Task[None]:
            return asyncio.create_task(limit({"type": "websocket", "client": (host, 1)}, nothing, note))

        sockets = [open_for("a"), open_for("a"), open_for("b"), open_for("a")]
        await asyncio.sleep(0.0)
        await asyncio.sleep(0.0)
        go.set()
        await asyncio.gather(*sockets)
        await open_for("a")
        return told

    told = asyncio.run(scenario())
    assert entered == ["a", "a", "b", "a"]
    assert [message.get("code") for message in told if message["type"] == "websocket.close"] == [4429]
