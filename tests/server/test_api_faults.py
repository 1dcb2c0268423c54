"""What a fault does over REST: whether it acts, in how many epochs, and why not."""

from __future__ import annotations

from typing import Any

from fastapi.testclient import TestClient
from rest_lab import Flight

BIAS = {"channel": "ruler.position.x", "kind": "bias", "magnitude": 5.0}


def fault(flight: Flight, id: str = "f1") -> dict[str, Any]:
    found: dict[str, Any] = flight.get(f"/faults/{id}")
    return found


def kinds(flight: Flight, id: str = "f1") -> list[str]:
    return [e["kind"] for e in flight.get("/events") if e["detail"].get("id") == id]


def test_given_a_fault_then_it_says_that_it_acts_and_in_how_many_epochs(flight: Flight) -> None:
    made = flight.do("POST", "/faults", BIAS | {"start": 0.5, "end": 1.0})
    assert (made["acting"], made["acted_epochs"], made["silent_because"]) == (False, 0, "armed; starts at 0.5 s")
    flight.advance(until=0.7)
    assert (fault(flight)["acting"], fault(flight)["acted_epochs"], fault(flight)["silent_because"]) == (True, 3, None)
    flight.advance(until=2.0)
    assert (fault(flight)["acting"], fault(flight)["acted_epochs"]) == (False, 5)
    assert fault(flight)["silent_because"] == "ended at 1 s"
    assert kinds(flight) == ["fault.injected", "fault.started", "fault.acted", "fault.ended"]
    acted = next(e for e in flight.get("/events") if e["kind"] == "fault.acted")
    assert (acted["time"], acted["run"]) == (0.5, 0)


def test_given_a_sensor_that_is_switched_off_then_its_fault_is_silent_and_says_so_until_it_is_on_again(
    flight: Flight,
) -> None:
    flight.do("PATCH", "/subsystems/ruler", {"enabled": False})
    made = flight.do("POST", "/faults", BIAS)
    assert made["silent_because"] == "ruler is switched off"
    flight.advance(until=1.0)
    assert fault(flight)["acted_epochs"] == 0
    flight.do("PATCH", "/subsystems/ruler", {"enabled": True})
    flight.advance(epochs=1)
    assert fault(flight)["acting"]


def test_given_a_fault_that_is_covered_to_its_end_then_that_is_an_event_with_the_reason(flight: Flight) -> None:
    flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "dropout"})
    flight.do("POST", "/faults", BIAS | {"end": 1.0})
    flight.advance(until=2.0)
    assert kinds(flight, "f2") == ["fault.injected", "fault.started", "fault.ended", "fault.silent"]
    silent = next(e for e in flight.get("/events") if e["kind"] == "fault.silent")
    assert silent["run"] == -1
    assert "the dropout f1 covers it" in silent["detail"]["because"]
    assert "never having acted" in fault(flight, "f2")["silent_because"]


def test_given_a_finished_flight_then_a_fault_is_refused_and_says_what_to_do(flight: Flight) -> None:
    flight.advance()
    answer = flight.ask("POST", "/faults", BIAS)
    assert answer.status_code == 409
    assert answer.json()["detail"] == "the flight is over at 60 s; rewind it, or fork from before"


def test_given_a_flight_with_faults_then_rewind_fork_and_replay_give_the_same_answers(
    client: TestClient, flight: Flight
) -> None:
    flight.advance(until=1.0)
    flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "outliers", "magnitude": 3.0, "rate": 0.3})
    flight.advance(until=2.0)
    before = flight.get("/faults")
    flight.advance(until=4.0)
    flight.do("POST", "/rewind", {"to": 2.0})
    assert flight.get("/faults") == before
    branch = flight.do("POST", "/fork", {"at": 2.0})
    assert branch["faults"] == before
    replay = Flight(client, flight.get("/scenario"))
    replay.advance(until=2.0)
    assert replay.get("/faults") == before


def test_given_a_script_whose_fault_starts_in_the_past_then_the_document_is_refused(client: TestClient) -> None:
    import toy_system as toy

    command = {"action": "inject", "time": 5.0, "fault": BIAS | {"start": 2.0}}
    answer = client.post("/api/v1/experiments", json={"scenario": toy.scenario(commands=[command])})
    assert answer.status_code == 409
    assert "start is 2 s, but the command is given at 5 s" in answer.json()["detail"]
