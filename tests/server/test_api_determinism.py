"""The same scenario, seed and commands give the same bits, whichever way the flight was flown."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest
from fastapi.testclient import TestClient
from rest_lab import API, Flight

END = 24.0
NAMES = "fused.error.position.up,gps.error.position.up,test.residual.gps.statistic,unprotected.error.velocity.east"


def at_once(flight: Flight) -> None:
    command(flight, 6.0, 15.0)
    flight.advance(until=END)


def in_pieces(flight: Flight) -> None:
    for until in (1.0, 2.0, 5.0):
        flight.advance(until=until)
    command(flight, 6.0, 15.0)
    for _ in range(7):
        flight.advance(epochs=1)
    flight.advance(until=END)


def by_the_clock(flight: Flight) -> None:
    command(flight, 6.0, 15.0)
    flight.do("PATCH", "/clock", {"state": "running", "speed": "max"})
    while flight.get()["clock"]["time"] < END:
        time.sleep(0.02)
    flight.do("PATCH", "/clock", {"state": "paused"})


def with_a_rewind(flight: Flight) -> None:
    flight.advance(until=4.0)
    flight.do("POST", "/faults", {"channel": "doppler.velocity.x", "kind": "bias", "magnitude": 9.0})
    flight.advance(until=9.0)
    flight.do("POST", "/rewind", {"to": 3.0})
    at_once(flight)


def command(flight: Flight, start: float, later: float) -> None:
    """Two faults that are armed before either begins, so that every way of flying can give the same commands."""
    for channel, when in (("gps.pseudorange.C1", start), ("imu.accelerometer.3y", later)):
        flight.do(
            "POST",
            "/faults",
            {"id": f"at{when:.0f}", "channel": channel, "kind": "bias", "magnitude": 60.0, "start": when},
        )


def bits(flight: Flight) -> dict[str, Any]:
    series = flight.get("/series", signals=NAMES, end=END)
    return {"time": series["time"], **series["signals"]}


@pytest.mark.parametrize("way", [in_pieces, by_the_clock, with_a_rewind])
def test_every_way_of_flying_gives_the_same_bits(client: TestClient, way: Callable[[Flight], None]) -> None:
    reference, other = (Flight(client, "zhang-1992-visible", seed=5) for _ in range(2))
    at_once(reference)
    way(other)
    assert bits(other) == bits(reference)


def test_what_was_run_can_be_posted_again_to_the_same_bits(client: TestClient) -> None:
    flight = Flight(client, "zhang-1992-visible", seed=5)
    flight.advance(until=5.0)
    flight.do("POST", "/faults", {"channel": "gps.pseudorange.C1", "kind": "ramp", "magnitude": 3.0})
    flight.do("PATCH", "/settings", {"false_alarm_probability": 0.01})
    flight.advance(until=12.0)
    flight.do("PATCH", "/subsystems/doppler", {"enabled": False})
    flight.advance(until=14.0)
    flight.do("DELETE", "/faults")
    flight.advance(until=END)

    document = client.get(f"{flight.path}/scenario").json()
    again = Flight(client, document)
    again.advance(until=END)

    assert bits(again) == bits(flight)
    assert again.get("/scenario") == document
    kinds = [[(e["time"], e["kind"], e["subject"]) for e in f.get("/events")] for f in (flight, again)]
    assert kinds[0] == kinds[1]


def test_the_seed_makes_the_noise(client: TestClient) -> None:
    one, same, other = (Flight(client, "zhang-1992", seed=seed) for seed in (1, 1, 2))
    for flight in (one, same, other):
        flight.advance(until=3.0)
    assert bits(one) == bits(same) != bits(other)


def test_numbers_survive_json_to_the_bit(client: TestClient) -> None:
    flight = Flight(client, "zhang-1992", seed=1)
    flight.advance(until=3.0)
    name = "fused.error.position.up"
    table = client.get(f"{flight.path}/series?signals={name}", headers={"accept": "text/csv"}).text.splitlines()
    assert [float(line.split(",")[1]) for line in table[1:]] == flight.get("/series", signals=name)["signals"][name]
    assert API in flight.path
