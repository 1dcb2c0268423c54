"""A run that a page started and left is paused after a while; one that a program flies is left alone."""

from __future__ import annotations

import pytest
from fastapi.testclient import TestClient
from rest_lab import Flight, wait_until

from server.attendance import PATIENCE, Attendance


class Clock:
    """Seconds that a test lets pass."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(client: TestClient, flight: Flight) -> Clock:
    """The clock by which the flight's watchers are counted."""
    made = Clock()
    client.app.state.registry.get(flight.id).attendance = Attendance(made)  # type: ignore[attr-defined]
    return made


def flies_on(flight: Flight) -> bool:
    """Whether it is still running after another epoch."""
    before = flight.get()["clock"]["epoch"]
    wait_until(lambda: flight.get()["clock"]["epoch"] > before or flight.get()["clock"]["state"] != "running")
    return flight.get()["clock"]["state"] == "running"


def left_running(flight: Flight) -> None:
    with flight.client.websocket_connect(flight.stream) as socket:
        socket.receive_json()
        flight.do("PATCH", "/clock", {"state": "running", "speed": 1})
    wait_until(lambda: flight.get()["watchers"] == 0)


def test_given_a_page_that_left_its_run_when_it_stays_away_then_the_run_is_paused_and_says_why(
    flight: Flight, clock: Clock
) -> None:
    left_running(flight)
    clock.now += PATIENCE - 1.0
    assert flies_on(flight)
    clock.now += 2.0
    wait_until(lambda: flight.get()["clock"]["state"] == "paused")
    assert "no page had watched it" in flight.get()["clock"]["reason"]
    assert flight.do("PATCH", "/clock", {"state": "running"})["clock"]["reason"] is None


def test_given_a_page_that_left_when_it_is_back_in_time_then_the_run_goes_on(flight: Flight, clock: Clock) -> None:
    left_running(flight)
    clock.now += PATIENCE - 1.0
    with flight.client.websocket_connect(flight.stream) as socket:
        socket.receive_json()
        clock.now += 10.0 * PATIENCE
        assert flies_on(flight)


@pytest.mark.parametrize("watched_before", [False, True])
def test_given_a_run_that_a_program_starts_when_nobody_watches_then_it_flies_on(
    flight: Flight, clock: Clock, watched_before: bool
) -> None:
    if watched_before:
        left_running(flight)
    flight.do("PATCH", "/clock", {"state": "running", "speed": 1})
    clock.now += 100.0 * PATIENCE
    assert flies_on(flight)
