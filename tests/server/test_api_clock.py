"""The clock: it keeps its pace, alone and in company, and whoever commands gets in between."""

from __future__ import annotations

import time
from itertools import pairwise

import httpx
import pytest
import toy_system as toy
from fastapi.testclient import TestClient
from rest_lab import API, Flight, served, wait_until

from server.pacing import SLIP, Pacer
from server.settings import Settings


def flown(flight: Flight) -> float:
    return float(flight.get()["clock"]["time"])


@pytest.mark.alone
def test_a_running_experiment_keeps_its_pace(flight: Flight) -> None:
    flight.do("PATCH", "/clock", {"state": "running", "speed": 5})
    begun, at = time.monotonic(), flown(flight)
    time.sleep(1.5)
    elapsed, now = time.monotonic() - begun, flown(flight)
    assert now - at == pytest.approx(5 * elapsed, abs=0.6)
    assert flight.do("PATCH", "/clock", {"state": "paused"})["clock"]["state"] == "paused"
    stopped = flown(flight)
    time.sleep(0.2)
    assert flown(flight) == stopped


def test_the_speed_can_be_changed_in_flight(flight: Flight) -> None:
    flight.do("PATCH", "/clock", {"state": "running", "speed": 0.5})
    assert flight.do("PATCH", "/clock", {"speed": "max"})["clock"]["speed"] == "max"
    wait_until(lambda: flight.get()["clock"]["state"] == "finished")
    assert flown(flight) == 60.0


@pytest.mark.alone
def test_a_running_experiment_can_be_advanced_rewound_and_broken(flight: Flight) -> None:
    flight.do("PATCH", "/clock", {"state": "running", "speed": 1})
    assert flight.advance(until=30.0)["experiment"]["clock"]["state"] == "running"
    time.sleep(0.35)
    assert 30.1 < flown(flight) < 31.5  # at its pace from there on, not standing still until 30 s have gone by
    flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "bias", "magnitude": 1.0})
    assert flight.do("POST", "/rewind", {"to": 2.0})["clock"]["state"] == "paused"
    time.sleep(0.25)
    assert flown(flight) == 2.0


def test_a_clock_that_fails_says_why(client: TestClient) -> None:
    flight = Flight(client, toy.scenario(parameters={"fails_at": 3}))
    flight.do("PATCH", "/clock", {"state": "running", "speed": "max"})
    wait_until(lambda: flight.get()["clock"]["state"] == "failed")
    assert flight.get()["clock"]["reason"].startswith("ArithmeticError")


@pytest.mark.alone
def test_twenty_experiments_at_once_hold_their_pace() -> None:
    with served() as server, httpx.Client(base_url=server.base, timeout=20.0) as client:
        fleet = [Flight(client, "zhang-1992") for _ in range(20)]
        for flight in fleet:
            flight.do("PATCH", "/clock", {"state": "running", "speed": 1})
        begun = {flight.id: (time.monotonic(), flown(flight)) for flight in fleet}
        time.sleep(4.0)
        for flight in fleet:
            now, (then, at) = time.monotonic(), begun[flight.id]
            assert abs(flown(flight) - at - (now - then)) < 1.6  # an epoch is 1 s: one each way, and some grace


@pytest.mark.alone
def test_a_racing_experiment_does_not_slow_a_paced_one_or_the_commands() -> None:
    with served(Settings(workers=2)) as server, httpx.Client(base_url=server.base, timeout=20.0) as client:
        racers = [Flight(client, toy.scenario(duration=30_000.0)) for _ in range(3)]
        paced = Flight(client)
        for racer in racers:
            racer.do("PATCH", "/clock", {"state": "running", "speed": "max"})
        paced.do("PATCH", "/clock", {"state": "running", "speed": 1})
        begun, at = time.monotonic(), flown(paced)
        delays = []
        for k in range(20):
            asked = time.monotonic()
            racers[k % 3].do("PATCH", "/settings", {"threshold": 5.0 + k})
            delays.append(time.monotonic() - asked)
            time.sleep(0.05)
        assert flown(paced) - at == pytest.approx(time.monotonic() - begun, abs=0.6)
        assert sorted(delays)[10] < 0.25
        assert client.get(f"{API}/health").status_code == 200


def test_due_epochs_do_not_drift() -> None:
    pacer = Pacer(period=1.0, speed=10.0, epoch=0, now=100.0)
    epoch = 0
    for k in range(1, 1001):
        now = 100.0 + 0.1 * k + 0.03  # woken late every time
        assert pacer.wait(epoch, now) == 0.0
        due = pacer.due(epoch, now)
        assert due == k
        epoch = due
        pacer.flown(epoch)


def test_a_flight_that_cannot_keep_up_gives_up_what_it_missed() -> None:
    pacer = Pacer(period=1.0, speed=10.0, epoch=0, now=0.0)
    due = pacer.due(0, 50.0)
    assert due == int(SLIP * 10.0)
    pacer.flown(due)
    assert pacer.wait(due, 50.0) == pytest.approx(0.1)


def test_a_flight_that_was_moved_is_paced_from_where_it_is() -> None:
    pacer = Pacer(period=1.0, speed=1.0, epoch=0, now=0.0)
    assert pacer.due(0, 1.5) == 1
    pacer.flown(1)
    assert pacer.due(90, 2.5) == 90
    assert pacer.due(90, 3.5) == 91


def test_a_slow_flight_is_not_taken_for_a_late_one() -> None:
    pacer = Pacer(period=1.0, speed=0.5, epoch=0, now=0.0)
    for epoch in range(10):
        assert pacer.due(epoch, 2.0 * epoch + 2.1) == epoch + 1
        pacer.flown(epoch + 1)


def test_a_pacer_at_full_speed_never_waits() -> None:
    pacer = Pacer(period=1.0, speed="max", epoch=0, now=0.0)
    assert pacer.due(0, 0.0) is None
    assert pacer.wait(0, 0.0) == 0.0


def test_events_of_a_running_flight_are_in_order(client: TestClient) -> None:
    flight = Flight(client, toy.scenario(settings={"threshold": 1.0}))
    flight.do("PATCH", "/clock", {"state": "running", "speed": "max"})
    time.sleep(0.3)
    flight.do("PATCH", "/clock", {"state": "paused"})
    events = flight.get("/events")
    assert [event["index"] for event in events] == list(range(len(events)))
    assert all(a["time"] <= b["time"] for a, b in pairwise(events))
