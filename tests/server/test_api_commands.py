"""Whatever is done to an experiment over REST is a value that comes in by one door."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
import toy_system as toy
from fastapi.testclient import TestClient
from hand_clock import HandClock, laboratory
from pydantic import TypeAdapter
from rest_lab import Flight, wait_until

from ftcore import Fault, Scenario
from ftcore.commands import Advance, Change, Clear, Configure, Inject, Rewind, Switch
from server.commands import Clock, Command
from server.experiments import Experiment

BIAS = {"id": "a", "channel": "ruler.position.x", "kind": "bias", "magnitude": 5.0}


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Commands as they come to the door."""
    commands: list[Any] = []
    door = Experiment.do

    async def watched(experiment: Experiment, command: Any, *more: Any) -> Any:
        commands.append(command)
        return await door(experiment, command, *more)

    monkeypatch.setattr(Experiment, "do", watched)
    return commands


def test_given_every_route_that_does_something_then_it_sends_a_value(flight: Flight, seen: list[Any]) -> None:
    flight.do("POST", "/faults", BIAS)
    flight.do("POST", "/advance", {"until": 1.0})
    flight.do("PATCH", "/faults/a", {"magnitude": 7.0})
    flight.do("PATCH", "/subsystems/ruler", {"enabled": False})
    flight.do("PATCH", "/settings", {"threshold": 9.0})
    flight.do("DELETE", "/faults/a")
    flight.do("DELETE", "/faults")
    flight.do("POST", "/rewind", {"to": 0.5})
    flight.do("PATCH", "/clock", {"speed": 2.0})
    flight.do("POST", "/ghost")
    assert seen == [
        Inject(time=0.0, fault=Fault.model_validate(BIAS)),
        Advance(time=0.0, until=1.0),
        Change(time=1.0, fault="a", fields={"magnitude": 7.0}),
        Switch(time=1.0, subsystem="ruler", enabled=False),
        Configure(time=1.0, settings={"threshold": 9.0}),
        Clear(time=1.0, fault="a"),
        Clear(time=1.0),
        Rewind(time=1.0, to=0.5),
        Clock(time=0.5, speed=2.0),
        Advance(time=0.0, epochs=5),
    ]
    adapter: TypeAdapter[Any] = TypeAdapter(Command)
    assert [adapter.validate_json(adapter.dump_json(command)) for command in seen] == seen


def test_given_a_command_whose_time_goes_by_while_it_waits_for_its_turn_then_it_is_done_then() -> None:
    async def story() -> None:
        async with laboratory(HandClock()) as registry:
            experiment = await registry.create(Scenario.model_validate(toy.scenario()))
            await experiment.do(Advance(time=0.0, epochs=20))
            done = await experiment.do(Switch(time=1.0, subsystem="ruler", enabled=False))
            assert done.answer is not None
            assert done.answer.command == Switch(time=2.0, subsystem="ruler", enabled=False)
            assert not done.state.subsystems["ruler"].enabled
            assert done.state.clock.time == 2.0

    asyncio.run(story())


def test_given_a_command_for_later_then_it_waits_and_is_in_the_document() -> None:
    async def story() -> None:
        async with laboratory(HandClock()) as registry:
            experiment = await registry.create(Scenario.model_validate(toy.scenario()))
            later = Switch(time=1.0, subsystem="ruler", enabled=False)
            done = await experiment.do(later)
            assert done.answer is not None
            assert done.answer.outcome == "scheduled"
            assert (await experiment.do(Advance(time=0.0, until=0.9))).state.subsystems["ruler"].enabled
            assert not (await experiment.do(Advance(time=0.9, until=1.0))).state.subsystems["ruler"].enabled
            assert await experiment.read(lambda simulation: simulation.document().commands) == (later,)

    asyncio.run(story())


@pytest.mark.parametrize("way", ["clock", "advance"])
def test_given_a_scenario_whose_command_is_refused_then_it_says_so_stands_before_and_can_go_on(
    client: TestClient, way: str
) -> None:
    commands = [{"action": "change", "time": 1.0, "fault": "a", "fields": {"magnitude": 7.0}}]
    flight = Flight(client, toy.scenario(commands=commands))
    if way == "clock":
        flight.do("PATCH", "/clock", {"state": "running", "speed": "max"})
        wait_until(lambda: flight.get()["clock"]["state"] == "failed")
    else:
        refused = flight.ask("POST", "/advance", {"until": 2.0})
        assert refused.status_code == 409
        assert "command at 1 s is refused: no fault 'a'" in refused.json()["detail"]
    clock = flight.get()["clock"]
    assert (clock["state"], clock["time"]) == ("failed", pytest.approx(0.9))
    assert clock["reason"].startswith("the scenario's command at 1 s is refused: no fault 'a'")

    flight.do("POST", "/rewind", {"to": 0.9})
    flight.do("POST", "/faults", BIAS)
    assert flight.do("POST", "/advance", {"until": 2.0})["experiment"]["faults"][0]["magnitude"] == 7.0
    again = Flight(client, flight.get("/scenario"))
    again.do("POST", "/advance", {"until": 2.0})
    assert again.get("/events") == flight.get("/events")


def test_given_a_first_command_that_cannot_be_done_then_the_document_is_refused_with_its_place(
    client: TestClient,
) -> None:
    commands = [
        {"action": "inject", "time": 0.0, "fault": BIAS},
        {"action": "clear", "time": 0.0, "fault": "b"},
    ]
    answer = client.post("/api/v1/experiments", json={"scenario": toy.scenario(commands=commands)})
    assert answer.status_code == 409
    assert answer.json()["errors"][0]["pointer"] == "#/scenario/commands/1/fault"


@pytest.mark.parametrize(
    ("method", "path", "body"), [("DELETE", "/faults/b", None), ("PATCH", "/faults/b", {"end": 9})]
)
def test_given_no_such_fault_then_404_lists_those_there_are(
    flight: Flight, method: str, path: str, body: dict[str, Any] | None
) -> None:
    flight.do("POST", "/faults", BIAS)
    for name in (path, path + ".."):
        answer = flight.ask(method, name, body)
        assert answer.status_code == 404
    assert "there is a" in flight.ask(method, path, body).json()["detail"]
