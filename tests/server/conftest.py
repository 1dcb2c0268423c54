"""The server under test, with the toy system beside the real ones."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from fastapi.testclient import TestClient

from ftcore.systems.registry import SYSTEMS
from server.app import create_app
from server.settings import Settings
from tests.server import toy

BASE = "http://127.0.0.1:8000"
API = "/api/v1"

SYSTEMS["toy"] = toy.Toy()  # type: ignore[assignment]


@pytest.fixture
def settings() -> Settings:
    return Settings()


@pytest.fixture
def client(settings: Settings) -> Iterator[TestClient]:
    with TestClient(create_app(settings), base_url=BASE, raise_server_exceptions=False) as client:
        yield client


class Flight:
    """An experiment over REST, in the words of a test."""

    def __init__(self, client: TestClient, document: Any = None, **body: Any) -> None:
        self.client = client
        answer = client.post(f"{API}/experiments", json={"scenario": document or toy.scenario()} | body)
        assert answer.status_code == 201, answer.text
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
        return f"{self.path}/stream"


@pytest.fixture
def flight(client: TestClient) -> Flight:
    return Flight(client)
