"""The server under test, with the toy system beside the real ones."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from fastapi.testclient import TestClient
from lab import Flight, client_of


@pytest.fixture
def client() -> Iterator[TestClient]:
    with client_of() as client:
        yield client


@pytest.fixture
def flight(client: TestClient) -> Flight:
    return Flight(client)
