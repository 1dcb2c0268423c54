"""A test's words for the server: a client, an experiment over REST, and a real server on a real port."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import toy_system as toy
from fastapi.testclient import TestClient

from server.app import create_app
from server.serving import GRACE, server_of
from server.settings import Settings

BASE = "http://127.0.0.1:8000"
API = "/api/v1"


def client_of(settings: Settings | None = None, base: str = BASE) -> TestClient:
    """The application without a network; to be entered."""
    return TestClient(create_app(settings or Settings()), base_url=base, raise_server_exceptions=False)


def wait_until(true: Callable[[], bool], seconds: float = 60.0) -> None:
    """Until something is so. The limit is there for what never comes, not for what comes late."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, f"not so within {seconds} s"
        time.sleep(0.02)


class Flight:
    """An experiment over REST."""

    def __init__(self, client: Any, document: Any = None, **body: Any) -> None:
        answer = client.post(f"{API}/experiments", json={"scenario": document or toy.scenario()} | body)
        assert answer.status_code == 201, answer.text
        self.client = client
        self.made = answer.json()
        self.id = self.made["id"]
        self.path = f"{API}/experiments/{self.id}"

    def get(self, what: str = "", **parameters: Any) -> Any:
        answer = self.client.get(f"{self.path}{what}", params=parameters)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def ask(self, method: str, what: str, body: Any = None) -> Any:
        return self.client.request(method, f"{self.path}{what}", json=body)

    def do(self, method: str, what: str, body: Any = None) -> Any:
        answer = self.ask(method, what, body)
        assert answer.status_code < 300, answer.text
        return answer.json() if answer.content else None

    def advance(self, **how: Any) -> Any:
        return self.do("POST", "/advance", how)

    @property
    def stream(self) -> str:
        return f"{BASE.replace('http', 'ws')}{self.path}/stream"


class Served:
    """The application on a real port, its loop in a thread."""

    def __init__(self, settings: Settings, grace: float) -> None:
        self.socket = socket.socket()
        self.socket.bind(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.base = f"http://127.0.0.1:{self.port}"
        self.app = create_app(settings)
        self.server = server_of(self.app, grace)
        self.loop: asyncio.AbstractEventLoop | None = None

    def run(self) -> None:
        async def serve() -> None:
            self.loop = asyncio.get_running_loop()
            await self.server.serve(sockets=[self.socket])

        asyncio.run(serve())


@contextlib.contextmanager
def served(settings: Settings | None = None, grace: float = GRACE) -> Iterator[Served]:
    """The application on a real port of this machine, which gives requests that ``grace`` [s] at its end."""
    server = Served(settings or Settings(), grace)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    wait_until(lambda: server.server.started, 20.0)
    try:
        yield server
    finally:
        server.server.should_exit = True
        thread.join(60.0)
