"""What a flight hands back is a scenario that is taken again, however much was done to it."""

from __future__ import annotations

import pytest

from ftcore import CommandError, Fault, Scenario, Simulation, commandlog
from ftcore.commandlog import MAX_BYTES, CommandLog, size_of
from ftcore.commands import Clear, Configure, Switch
from ftcore.scenario import MAX_COMMANDS

SCENARIO = Scenario.load("chey-2004")
ON_OFF = [Switch(time=0.0, subsystem="gps", enabled=bool(i % 2)) for i in range(MAX_COMMANDS)]


def full(log: CommandLog) -> bool:
    refused = 0
    for take in (log.with_done, log.with_waiting):
        try:
            take(ON_OFF[0].model_copy(update={"time": 5.0}))
        except CommandError as error:
            refused += error.field == "commands"
    assert refused in (0, 2)
    return refused == 2


def test_given_a_log_holds_as_many_as_a_scenario_then_one_more_is_refused() -> None:
    log = CommandLog.of(ON_OFF[:-1])
    assert not full(log)
    assert full(log.with_done(ON_OFF[-1].model_copy(update={"time": 5.0})))
    assert not full(log.with_done(ON_OFF[-1].model_copy(update={"time": 5.0})).until(4.0))


def test_given_commands_of_many_bytes_then_their_size_is_the_limit() -> None:
    long = Configure(time=1.0, settings={"false_alarm_probability": 0.001, "note": "x" * 10_000})
    log, count = CommandLog(), 0
    while not full(log):
        fits = log.size + size_of(long) <= MAX_BYTES
        log, count = log.with_done(long if fits else ON_OFF[0].model_copy(update={"time": 1.0})), count + 1
    assert MAX_BYTES - size_of(ON_OFF[0]) < log.size <= MAX_BYTES
    assert count < MAX_COMMANDS
    assert log.until(0.5).size == 0


def room_for(simulation: Simulation, more: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the log of a flight take so many more commands."""
    monkeypatch.setattr(commandlog, "MAX_COMMANDS", len(simulation.document().commands) + more)


def test_given_the_log_is_full_then_every_command_is_refused_and_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = Simulation(SCENARIO.model_copy(update={"faults": ()}), seed=3).advance(epochs=3)
    fault = Fault(channel="gps.pseudorange.A2", kind="bias", magnitude=10.0)
    first, _ = simulation.inject(fault), simulation.inject(fault)
    room_for(simulation, 1, monkeypatch)
    before, events = simulation.document(), len(simulation.events)
    simulation.change(str(first.id), magnitude=20.0)
    after = simulation.document()
    for command in (
        lambda: simulation.inject(fault),
        lambda: simulation.change(str(first.id), magnitude=30.0),
        lambda: simulation.clear(str(first.id)),
        simulation.clear_all,
        lambda: simulation.switch("gps", False),
        lambda: simulation.configure(false_alarm_probability=0.01),
    ):
        with pytest.raises(CommandError, match="the command log is full"):
            command()
    assert len(before.commands) == 2
    assert simulation.document() == after
    assert len(simulation.events) == events + 1
    assert [live.state for live in simulation.faults] == ["active", "active"]
    assert simulation.subsystems["gps"].enabled
    assert simulation.advance(epochs=1).epoch == 4


def test_given_the_log_is_full_then_a_rewind_makes_room_and_a_fork_has_that_of_its_past(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation = Simulation(SCENARIO, seed=3).advance(epochs=1).switch("gps", False).advance(epochs=1)
    room_for(simulation, 0, monkeypatch)
    with pytest.raises(CommandError, match="the command log is full"):
        simulation.switch("gps", True)
    assert not simulation.fork(at=0.0).switch("gps", False).subsystems["gps"].enabled
    simulation.rewind(0.0).switch("gps", False)
    assert len(simulation.document().commands) == 1


def test_given_a_document_with_a_full_log_then_it_is_taken_and_its_own_commands_are_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(commandlog, "MAX_COMMANDS", 200)
    clear = Clear(time=0.0)
    scenario = Scenario.model_validate(
        SCENARIO.model_dump(mode="json") | {"commands": [c.model_dump() for c in [*ON_OFF[:199], clear]]}
    )
    simulation = Simulation(scenario)
    assert not simulation.subsystems["gps"].enabled
    assert Scenario.model_validate_json(simulation.document().model_dump_json()) == simulation.document()
    with pytest.raises(CommandError, match="the command log is full"):
        simulation.switch("gps", True)
