"""Experiments over REST: made, flown, broken, rewound, branched, deleted."""

from __future__ import annotations

import toy_system as toy
from fastapi.testclient import TestClient
from rest_lab import API, Flight


def test_an_experiment_starts_paused_at_zero_and_says_where_it_is(client: TestClient) -> None:
    answer = client.post(f"{API}/experiments", json={"scenario": toy.scenario(), "seed": 11, "title": "mine"})

    assert answer.status_code == 201
    made = answer.json()
    assert answer.headers["location"] == f"{API}/experiments/{made['id']}"
    assert client.get(answer.headers["location"]).json() == made
    assert made["title"] == "mine"
    assert made["seed"] == 11
    assert made["system"] == "toy"
    assert made["clock"] == {
        "state": "paused", "time": 0.0, "epoch": 0, "period": 0.1, "speed": 1.0, "duration": 60.0, "reason": None
    }  # fmt: skip
    assert made["scenario"] == {"id": "toy", "title": "Toy", "hint": ""}
    assert made["subsystems"] == {"ruler": {"enabled": True, "used": True, "health": "ok"}}
    assert made["parent"] is None
    assert made["ghost_of"] is None
    assert [made] == client.get(f"{API}/experiments").json()


def test_every_ready_scenario_can_be_flown(client: TestClient) -> None:
    for scenario in client.get(f"{API}/scenarios").json():
        flight = Flight(client, scenario["id"])
        assert flight.advance(epochs=2)["experiment"]["clock"]["epoch"] == 2


def test_an_advance_answers_state_events_and_last_values(flight: Flight) -> None:
    flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "bias", "magnitude": 50.0, "start": 1.0})

    answer = flight.advance(until=2.0)

    assert answer["experiment"]["clock"]["time"] == 2.0
    assert {"test.alarmed", "subsystem.isolated"} <= {event["kind"] for event in answer["events"]}
    assert 40.0 < answer["latest"]["fused.error.position.x"] < 60.0
    assert answer["latest"]["gap"] is None
    assert flight.advance(epochs=1)["experiment"]["clock"]["epoch"] == 21


def test_an_advance_without_a_goal_flies_to_the_end(flight: Flight) -> None:
    clock = flight.advance()["experiment"]["clock"]

    assert (clock["state"], clock["time"]) == ("finished", 60.0)
    assert flight.advance(epochs=5)["experiment"]["clock"]["time"] == 60.0
    assert flight.ask("PATCH", "/clock", {"state": "running"}).status_code == 409


def test_a_fault_is_injected_changed_and_cleared(flight: Flight) -> None:
    flight.advance(until=1.0)

    fault = flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "bias", "magnitude": 50.0})
    assert (fault["start"], fault["state"], fault["unit"]) == (1.0, "active", "m")

    changed = flight.do("PATCH", f"/faults/{fault['id']}", {"magnitude": 20.0, "end": 9.0})
    assert (changed["magnitude"], changed["end"], changed["kind"]) == (20.0, 9.0, "bias")

    flight.advance(until=2.0)
    cleared = flight.do("DELETE", f"/faults/{fault['id']}")
    assert (cleared["state"], cleared["end"]) == ("ended", 2.0)
    assert flight.get()["faults"] == [cleared] == flight.get("/faults")
    assert flight.get(f"/faults/{fault['id']}") == cleared
    kinds = [event["kind"] for event in flight.get("/events")]
    assert [kind for kind in kinds if kind.startswith("fault.") and kind != "fault.started"] == [
        "fault.injected", "fault.changed", "fault.acted", "fault.cleared"
    ]  # fmt: skip


def test_all_faults_are_cleared_at_once(flight: Flight) -> None:
    for magnitude in (10.0, 20.0):
        flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "bias", "magnitude": magnitude})
    flight.advance(until=1.0)

    assert [fault["state"] for fault in flight.do("DELETE", "/faults")] == ["ended", "ended"]
    assert flight.do("DELETE", "/faults") == []


def test_subsystems_and_settings_are_changed(flight: Flight) -> None:
    assert flight.do("PATCH", "/subsystems/ruler", {"enabled": False})["subsystems"]["ruler"] == {
        "enabled": False, "used": False, "health": "off"
    }  # fmt: skip
    assert flight.do("PATCH", "/settings", {"threshold": 7.5})["settings"] == {"threshold": 7.5}


def test_a_rewind_forgets_what_came_later(flight: Flight) -> None:
    flight.advance(until=5.0)
    flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "bias", "magnitude": 50.0})
    flight.advance(until=8.0)

    state = flight.do("POST", "/rewind", {"to": 3.0})

    assert (state["clock"]["time"], state["clock"]["state"]) == (3.0, "paused")
    assert state["faults"] == []
    assert flight.get("/series", signals="fused.error.position.x")["time"][-1] == 3.0
    assert all(event["time"] <= 3.0 for event in flight.get("/events"))


def test_a_finished_flight_can_be_rewound_and_flown_on(flight: Flight) -> None:
    flight.advance()
    assert flight.do("POST", "/rewind", {"to": 30.0})["clock"]["state"] == "paused"
    assert flight.advance(epochs=1)["experiment"]["clock"]["epoch"] == 301


def test_a_fork_shares_the_past_and_has_its_own_future(client: TestClient, flight: Flight) -> None:
    flight.advance(until=5.0)
    answer = flight.ask("POST", "/fork", {"at": 3.0, "title": "other"})
    assert answer.status_code == 201
    branch = Flight.__new__(Flight)
    branch.client, branch.path = client, answer.headers["location"]
    assert (answer.json()["parent"], answer.json()["title"]) == (flight.id, "other")
    assert answer.json()["clock"]["time"] == 3.0

    branch.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "bias", "magnitude": 50.0})
    branch.advance(until=5.0)

    name = "fused.error.position.x"
    ours, theirs = (f.get("/series", signals=name)["signals"][name] for f in (flight, branch))
    assert ours[:30] == theirs[:30]
    assert abs(theirs[-1] - ours[-1] - 50.0) < 1e-9  # the same noise


def test_a_fault_free_twin_is_the_same_flight_without_faults(client: TestClient, flight: Flight) -> None:
    flight.do("POST", "/faults", {"channel": "ruler.position.x", "kind": "bias", "magnitude": 50.0})
    flight.do("PATCH", "/settings", {"threshold": 9.0})
    flight.advance(until=4.0)

    twin = flight.ask("POST", "/ghost").json()

    assert (twin["ghost_of"], twin["clock"]["time"], twin["faults"]) == (flight.id, 4.0, [])
    assert twin["settings"] == {"threshold": 9.0}
    name = "fused.error.position.x"
    healthy = client.get(f"{API}/experiments/{twin['id']}/series", params={"signals": name}).json()
    broken = flight.get("/series", signals=name)
    assert all(abs(b - h - 50.0) < 1e-9 for b, h in zip(broken["signals"][name], healthy["signals"][name], strict=True))


def test_a_deleted_experiment_is_gone(client: TestClient, flight: Flight) -> None:
    flight.do("PATCH", "/clock", {"state": "running"})
    flight.do("DELETE", "")
    assert client.get(flight.path).status_code == 404
    assert client.get(f"{API}/experiments").json() == []
    assert client.get(f"{API}/health").json() == {"status": "ok", "experiments": 0}


def test_the_view_can_be_had_of_any_moment(flight: Flight) -> None:
    flight.advance(until=5.0)
    assert flight.get("/view")["time"] == 5.0
    assert flight.get("/view", at=2.0)["blocks"]["ruler"]["text"] == "2.0 s"
    assert flight.do("PUT", "/cursor", {"time": 2.0}) == {"time": 2.0, "picture": None}
    assert flight.do("PUT", "/cursor", {"time": None}) == {"time": None, "picture": None}


def test_a_system_says_all_a_page_needs(client: TestClient) -> None:
    system = client.get(f"{API}/systems/toy").json()
    assert system in client.get(f"{API}/systems").json()
    assert {signal["name"]: signal["factor"] for signal in system["signals"]}[
        "fused.error.angle"
    ] == 0.017453292519943295
    ruler = {channel["name"]: channel for channel in system["channels"]}["ruler.position.y"]
    assert ruler["faults"] == {
        "bias": {"label": "bias", "sentence": "a constant is added", "unit": "m", "largest": 1e7, "parameters": []},
        "ramp": {
            "label": "ramp", "sentence": "a drift that grows by the magnitude every second", "unit": "m/s",
            "largest": 1e7, "parameters": [],
        },
    }  # fmt: skip
    assert "magnitude" in system["fault_schema"]["properties"]
    assert client.get(f"{API}/schema/scenario").json()["properties"]["duration"]["unit"] == "s"


def test_one_experiment_that_breaks_down_leaves_others_alone(client: TestClient) -> None:
    other, doomed = Flight(client), Flight(client, toy.scenario(parameters={"fails_at": 7}))

    refused = doomed.ask("POST", "/advance", {"epochs": 20})

    assert refused.status_code == 409
    problem = refused.json()
    assert (problem["type"], problem["title"]) == ("urn:ftlab:problem:internal-failure", "Internal failure")
    assert "this is a defect of FTLab" in problem["detail"]
    assert "kept up to 0.6 s" in problem["detail"]
    clock = doomed.get()["clock"]
    assert (clock["state"], clock["epoch"]) == ("failed", 6)
    assert clock["reason"] == "ArithmeticError: the toy broke, as it was told to"
    assert doomed.ask("PATCH", "/clock", {"state": "running"}).status_code == 409
    assert len(doomed.get("/series", signals="gap")["time"]) == 6
    assert other.advance(epochs=20)["experiment"]["clock"]["epoch"] == 20
    assert doomed.do("POST", "/rewind", {"to": 0.5})["clock"] == clock | {
        "state": "paused", "epoch": 5, "time": 0.5, "reason": None
    }  # fmt: skip


def test_a_fault_on_what_is_not_fitted_is_refused_at_its_channel(client: TestClient) -> None:
    """Of two IMUs one is fitted; the experiment says which channels it lacks, and what would bring them."""
    made = client.post(f"{API}/experiments", json={"scenario": "yang-2016-scenario-1"}).json()
    reason = made["unavailable"]["imu.gyro.1x"]
    fault = {"channel": "imu.gyro.1x", "kind": "bias", "magnitude": 5.0}
    answer = client.post(f"{API}/experiments/{made['id']}/faults", json=fault)
    assert answer.status_code == 409
    assert answer.headers["content-type"] == "application/problem+json"
    assert reason in answer.json()["detail"]
    assert client.get(f"{API}/experiments/{made['id']}").json()["faults"] == made["faults"]
