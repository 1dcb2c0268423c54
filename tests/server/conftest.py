"""The server under test, with the toy system beside the real ones."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import toy_system as toy
from fastapi.testclient import TestClient
from rest_lab import API, Flight, client_of

from ftcore.systems.registry import SYSTEMS


@pytest.fixture(autouse=True)
def _toy_system(monkeypatch: pytest.MonkeyPatch) -> None:
    """For server tests only: other tests see the real systems alone."""
    monkeypatch.setitem(SYSTEMS, "toy", toy.Toy())


@pytest.fixture(scope="module")
def _application() -> Iterator[TestClient]:
    with client_of() as client:
        yield client


@pytest.fixture
def client(_application: TestClient) -> Iterator[TestClient]:
    """One application for a file's tests; each finds it without experiments."""
    yield _application
    for experiment in _application.get(f"{API}/experiments").json():
        _application.delete(f"{API}/experiments/{experiment['id']}")


@pytest.fixture
def flight(client: TestClient) -> Flight:
    return Flight(client)
