"""The server under test, with the toy system beside the real ones."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import toy
from fastapi.testclient import TestClient
from lab import Flight, client_of

from ftcore.systems.registry import SYSTEMS


@pytest.fixture(autouse=True)
def _toy_system(monkeypatch: pytest.MonkeyPatch) -> None:
    """For server tests only: other tests see the real systems alone."""
    monkeypatch.setitem(SYSTEMS, "toy", toy.Toy())


@pytest.fixture
def client() -> Iterator[TestClient]:
    with client_of() as client:
        yield client


@pytest.fixture
def flight(client: TestClient) -> Flight:
    return Flight(client)
