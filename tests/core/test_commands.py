"""Commands are values: one door takes them, a log of them is flown again to the same bits, a refused one is nothing."""

from __future__ import annotations

import json
from itertools import count, pairwise
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from ftcore import CommandError, Fault, Scenario, Simulation
from ftcore.commands import (
    Advance,
    Answer,
    Change,
    Clear,
    Command,
    Configure,
    Inject,
    OperatorCommand,
    Rewind,
    Switch,
)

BARE = Scenario.load("chey-2004").model_copy(update={"faults": (), "duration": 40.0})
BIAS = Fault(channel="gps.pseudorange.A2", kind="bias", magnitude=60.0)
COMMANDS: list[Command] = [
    Inject(time=3.0, fault=BIAS.model_copy(update={"id": "a", "start": 5.0})),
    Change(time=6.0, fault="a", fields={"magnitude": 90.0, "end": None}),
    Configure(time=7.0, settings={"false_alarm_probability": 0.01}),
    Switch(time=8.0, subsystem="gps", enabled=False),
    Switch(time=10.0, subsystem="gps", enabled=True),
    Inject(time=10.0, fault=Fault(channel="gps.pseudorange.D3", kind="ramp", magnitude=2.0)),
    Clear(time=12.0, fault="a"),
    Clear(time=15.0),
]


def same(one: Simulation, other: Simulation) -> bool:
    """Whether two flights are the same to the last bit, in what they recorded and in what they announced."""
    return bool(np.array_equal(one.recording.rows, other.recording.rows, equal_nan=True)) and one.events == other.events


def everything(simulation: Simulation) -> tuple[Any, ...]:
    """All that a command may change."""
    return (
        simulation.document(),
        list(simulation.events),
        simulation.faults,
        simulation.subsystems,
        simulation.settings,
        simulation.now,
        simulation.recording.rows.copy().tobytes(),
    )


def by_hand(scenario: Scenario = BARE) -> Simulation:
    """A flight on which a person does what COMMANDS say, by the methods for people."""
    sim = Simulation(scenario).advance(until=3.0)
    sim.inject(BIAS.model_copy(update={"id": "a", "start": 5.0}))
    sim.advance(until=6.0).change("a", magnitude=90.0, end=None)
    sim.advance(until=7.0).configure(false_alarm_probability=0.01)
    sim.advance(until=8.0).switch("gps", False).advance(until=10.0).switch("gps", True)
    sim.inject(Fault(channel="gps.pseudorange.D3", kind="ramp", magnitude=2.0))
    sim.advance(until=12.0).clear("a")
    sim.advance(until=15.0).clear_all()
    return sim.advance()


# ---- values


@pytest.mark.parametrize(
    "command", [*COMMANDS, Advance(time=1.0, until=9.0), Advance(time=0.0), Rewind(time=9.0, to=2)]
)
def test_given_a_command_then_it_is_json_and_back_to_the_same_value(command: Command) -> None:
    adapter: TypeAdapter[Command] = TypeAdapter(Command)
    text = adapter.dump_json(command)
    assert json.loads(text)["action"] == command.action
    assert adapter.validate_json(text) == command
    assert adapter.validate_python(command.model_dump(exclude_defaults=True)) == command
    with pytest.raises(ValidationError):
        command.time = 5.0  # type: ignore[misc]
    schema = adapter.json_schema()
    assert schema["discriminator"]["propertyName"] == "action"
    form = schema["$defs"][type(command).__name__]
    assert {"action", "time"} <= set(form["required"])


def test_given_numbers_of_numpy_and_tuples_then_the_command_in_the_log_is_the_one_that_json_gives_back() -> None:
    sim = Simulation(BARE).advance(epochs=np.int64(2))
    fault = sim.inject(BIAS)
    sim.change(str(fault.id), magnitude=np.float32(0.5), end=np.int64(30))
    sim.configure(false_alarm_probability=np.float64(0.01))
    sim.switch("gps", np.bool_(False))
    assert sim.document().commands[1].fields == {"magnitude": 0.5, "end": 30}  # type: ignore[union-attr]
    assert Scenario.model_validate_json(sim.document().model_dump_json()) == sim.document()
    tuples = Configure(time=1.0, settings={"pair": (1, 2)})
    assert Configure.model_validate_json(tuples.model_dump_json()) == tuples


@pytest.mark.parametrize("wrong", [object(), float("nan"), float("inf"), "\ud800", {1, 2}])
def test_given_a_value_that_json_has_not_then_it_is_refused_by_its_name_and_nothing_changes(wrong: Any) -> None:
    sim = Simulation(BARE).advance(epochs=2)
    fault = sim.inject(BIAS)
    before = everything(sim)
    for name, do in (
        ("magnitude", lambda: sim.change(str(fault.id), magnitude=wrong)),
        ("false_alarm_probability", lambda: sim.configure(false_alarm_probability=wrong)),
    ):
        with pytest.raises(CommandError) as refused:
            do()
        assert refused.value.field == name
    with pytest.raises(ValidationError):
        Configure(time=2.0, settings={"false_alarm_probability": wrong})
    assert everything(sim) == before


def test_given_a_command_then_the_answer_is_a_value_too() -> None:
    sim = Simulation(BARE).advance(until=2.0)
    answers = [
        sim.do(Inject(time=2.0, fault=BIAS)),
        sim.do(Inject(time=2.0, fault=BIAS.model_copy(update={"start": 30.0}))),
        sim.do(Switch(time=2.0, subsystem="gps", enabled=True)),
        sim.do(Switch(time=9.0, subsystem="gps", enabled=False)),
        sim.do(Advance(time=2.0, epochs=3)),
        sim.do(Clear(time=5.0)),
        sim.do(Clear(time=5.0)),
        sim.do(Rewind(time=5.0, to=5.0)),
        sim.do(Rewind(time=5.0, to=1.0)),
    ]
    assert [a.outcome for a in answers] == [
        "done", "done", "unchanged", "scheduled", "done", "done", "unchanged", "unchanged", "done",
    ]  # fmt: skip
    assert [a.time for a in answers] == [2.0, 2.0, 2.0, 2.0, 5.0, 5.0, 5.0, 5.0, 1.0]
    assert (answers[0].faults[0].id, answers[0].faults[0].start) == ("f1", 2.0)
    assert answers[0].command.fault == answers[0].faults[0]  # type: ignore[union-attr]
    assert [(f.id, f.end) for f in answers[5].faults] == [("f1", 5.0), ("f2", None)]
    for answer in answers:
        assert Answer.model_validate_json(answer.model_dump_json()) == answer


# ---- one door


def test_given_any_method_that_does_something_then_it_comes_through_the_door(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Command] = []
    door = Simulation.do
    monkeypatch.setattr(Simulation, "do", lambda sim, command: seen.append(command) or door(sim, command))
    sim = by_hand()
    sim.rewind(to=9.0)
    assert [command for command in seen if not isinstance(command, Advance | Rewind)] == COMMANDS
    assert seen[-1] == Rewind(time=40.0, to=9.0)
    assert all(a.time <= b.time for a, b in pairwise(seen))


# ---- replay


def test_given_a_log_then_doing_its_commands_flies_it_again_to_the_same_bits() -> None:
    flown = by_hand()
    log = flown.document().commands
    assert [c.action for c in log] == [c.action for c in COMMANDS]
    ahead, in_time, replayed = Simulation(BARE), Simulation(BARE), Simulation(flown.document())
    for command in log:
        ahead.do(command)
        in_time.advance(until=command.time).do(command)
    for again in (ahead, in_time, replayed):
        assert same(again.advance(), flown)
        assert again.document().commands == log
    assert same(Simulation(replayed.document()).advance(), flown)


def test_given_a_record_of_all_that_was_done_rewinds_too_then_it_flies_again_to_the_same_bits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record: list[Command] = []
    door = Simulation.do
    with monkeypatch.context() as patched:
        patched.setattr(Simulation, "do", lambda sim, command: record.append(command) or door(sim, command))
        sim = Simulation(BARE).advance(until=5.0)
        sim.inject(BIAS)
        sim.advance(until=20.0).switch("gps", False).advance(until=25.0)
        sim.rewind(to=12.0).configure(false_alarm_probability=0.02)
        sim.advance(until=30.0).clear_all()
        sim.advance()
    text = TypeAdapter(list[Command]).dump_json(record)
    without_advances = [command for command in record if not isinstance(command, Advance)]
    for commands in (TypeAdapter(list[Command]).validate_json(text), without_advances):
        again = Simulation(BARE)
        for command in commands:
            again.do(command)
        again.advance()
        assert same(again, sim)
        assert again.document() == sim.document()


def test_given_commands_for_later_then_they_wait_and_a_rewind_forgets_those_after_it() -> None:
    sim = Simulation(BARE)
    off, on = Switch(time=10.0, subsystem="gps", enabled=False), Switch(time=20.0, subsystem="gps", enabled=True)
    assert sim.do(on).outcome == "scheduled"
    assert sim.advance(until=5.0).do(off).outcome == "scheduled"
    assert sim.subsystems["gps"].enabled
    assert sim.document().commands == (off, on)
    sim.advance(until=15.0)
    assert not sim.subsystems["gps"].enabled
    assert sim.advance(until=25.0).subsystems["gps"].enabled
    flown = sim.fork().advance()
    assert same(Simulation(sim.document()).advance(), flown)

    assert sim.fork(at=12.0).document().commands == (off,)
    assert sim.fork(at=8.0).document().commands == ()
    assert sim.rewind(to=12.0).document().commands == (off,)
    sim.do(on)
    assert sim.fork().document().commands == (off, on)
    assert same(sim.advance(), flown)


def test_given_a_scenario_with_commands_and_a_rewind_then_its_own_come_again_and_the_operators_do_not() -> None:
    scenario = BARE.model_copy(update={"commands": (Switch(time=10.0, subsystem="gps", enabled=False),)})
    sim = Simulation(scenario).advance(until=20.0)
    sim.switch("gps", True).advance(until=25.0).rewind(to=5.0)
    assert sim.document().commands == scenario.commands
    assert same(sim.advance(), Simulation(scenario).advance())


def test_given_settings_that_fit_only_together_then_a_log_of_them_can_be_done_ahead() -> None:
    bare = Scenario.load("zhang-1992").model_copy(update={"faults": (), "duration": 6.0})
    sim = Simulation(bare).advance(until=2.0)
    sim.configure(within=9)
    sim.advance(until=4.0).configure(confirm=9)
    again = Simulation(bare)
    for command in sim.document().commands:
        again.do(command)
    assert same(again.advance(), sim.advance())


def test_given_commands_out_of_order_and_between_epochs_then_each_is_done_at_the_epoch_after_its_time() -> None:
    commands = (
        Switch(time=20.4, subsystem="gps", enabled=True),
        Switch(time=9.5, subsystem="gps", enabled=False),
        Inject(time=9.5, fault=BIAS.model_copy(update={"start": 9.5})),
        Configure(time=10.0, settings={"false_alarm_probability": 0.01}),
    )
    sim = Simulation(BARE.model_copy(update={"commands": commands})).advance()
    times = [
        (e.time, e.kind) for e in sim.events if e.kind in ("subsystem.switched", "fault.injected", "settings.changed")
    ]
    assert times == [
        (10.0, "subsystem.switched"),
        (10.0, "fault.injected"),
        (10.0, "settings.changed"),
        (21.0, "subsystem.switched"),
    ]
    assert sim.faults[0].fault.start == 10.0
    assert same(Simulation(sim.document()).advance(), sim)


# ---- refused


@pytest.mark.parametrize(
    ("command", "field"),
    [
        (Inject(time=5.0, fault=BIAS), "time"),
        (Inject(time=50.0, fault=BIAS), "time"),
        (Inject(time=10.0, fault=BIAS.model_copy(update={"channel": "gps.pseudorange.Z9"})), "channel"),
        (Inject(time=20.0, fault=BIAS.model_copy(update={"channel": "gps.pseudorange.Z9"})), "channel"),
        (Inject(time=20.0, fault=BIAS.model_copy(update={"start": 15.0})), "start"),
        (Inject(time=10.0, fault=BIAS.model_copy(update={"id": "there"})), "id"),
        (Change(time=10.0, fault="nobody", fields={"magnitude": 1.0}), "fault"),
        (Change(time=10.0, fault="there", fields={"colour": "red"}), "colour"),
        (Clear(time=10.0, fault="nobody"), "fault"),
        (Switch(time=10.0, subsystem="radar", enabled=False), "name"),
        (Switch(time=20.0, subsystem="radar", enabled=False), "name"),
        (Configure(time=10.0, settings={"colour": "red"}), "colour"),
        (Configure(time=20.0, settings={"colour": "red"}), "colour"),
        (Advance(time=10.0, until=20.0, epochs=3), "until"),
        (Advance(time=10.0, until=5.0), "until"),
        (Advance(time=20.0, until=15.0), "until"),
        (Advance(time=50.0), "time"),
        (Rewind(time=10.0, to=11.0), "to"),
        (Rewind(time=20.0, to=21.0), "to"),
        (Rewind(time=5.0, to=3.0), "time"),
    ],
)
def test_given_a_command_that_cannot_be_done_then_it_is_refused_by_field_and_changes_nothing(
    command: Command, field: str
) -> None:
    sim = Simulation(BARE).advance(until=4.0)
    sim.inject(BIAS.model_copy(update={"id": "there"}))
    sim.advance(until=10.0)
    before = everything(sim)
    with pytest.raises(CommandError) as refused:
        sim.do(command)
    assert refused.value.field == field
    assert everything(sim) == before


@pytest.mark.parametrize("id", ["no such", "../x", "", None, 5])
def test_given_an_id_that_no_fault_can_have_then_nothing_is_cleared_and_the_field_is_named(id: Any) -> None:
    sim = Simulation(BARE).advance(epochs=2)
    sim.inject(BIAS)
    before = everything(sim)
    for do in (sim.clear, lambda id: sim.change(id, magnitude=5.0)):
        with pytest.raises(CommandError) as refused:
            do(id)
        assert refused.value.field == "fault"
    assert everything(sim) == before


def test_given_a_fault_that_breaks_a_rule_then_the_field_is_the_one_that_breaks_it() -> None:
    sim = Simulation(BARE).advance(epochs=2)
    before = everything(sim)
    for wrong, field in ({"start": 9.0, "end": 5.0}, "end"), ({"rate": 0.5}, "rate"):
        with pytest.raises(CommandError) as refused:
            sim.inject(BIAS.model_copy(update=wrong))
        assert refused.value.field == field
    assert everything(sim) == before


def test_given_a_command_of_the_scenario_is_refused_at_its_time_then_the_flight_stands_before_and_loses_nothing() -> (
    None
):
    good, bad = Switch(time=12.0, subsystem="gps", enabled=False), Clear(time=12.0, fault="f9")
    after = Switch(time=13.0, subsystem="gps", enabled=True)
    sim = Simulation(BARE.model_copy(update={"commands": (good, bad, after)})).advance(until=11.0)
    before = everything(sim)
    for _ in range(2):
        with pytest.raises(CommandError, match=r"command at 12 s is refused: no fault 'f9'") as refused:
            sim.advance()
        assert refused.value.field == "commands.1.fault"
        assert everything(sim) == before
    assert same(sim, Simulation(BARE).advance(until=11.0))
    # A fault of that name makes the same command possible; nothing of it was lost.
    sim.inject(BIAS.model_copy(update={"id": "f9"}))
    sim.advance()
    assert sim.finished
    assert sim.document().commands[1:] == (good, bad, after)
    assert same(Simulation(sim.document()).advance(), sim)


@pytest.mark.parametrize(
    ("command", "field"),
    [
        (Inject(time=0.0, fault=BIAS.model_copy(update={"magnitude": 1e-12})), "commands.1.fault.magnitude"),
        (Change(time=0.0, fault="a", fields={"end": -5.0}), "commands.1.fields.end"),
        (Switch(time=0.0, subsystem="radar", enabled=False), "commands.1.subsystem"),
        (Configure(time=0.0, settings={"colour": "red"}), "commands.1.settings.colour"),
        (Clear(time=0.0, fault="f9"), "commands.1.fault"),
    ],
)
def test_given_the_first_commands_of_a_scenario_are_refused_then_the_field_says_where(
    command: OperatorCommand, field: str
) -> None:
    first = Inject(time=0.0, fault=BIAS.model_copy(update={"id": "a"}))
    with pytest.raises(CommandError) as refused:
        Simulation(BARE.model_copy(update={"commands": (first, command)}))
    assert refused.value.field == field


def test_given_a_defect_while_waiting_commands_are_done_then_the_flight_stands_as_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sim = Simulation(BARE)
    sim.do(Switch(time=6.0, subsystem="gps", enabled=False))
    sim.advance(until=5.0)
    before = everything(sim)
    calls = count()

    def breaks(*_: Any) -> None:
        raise KeyboardInterrupt(next(calls))

    with monkeypatch.context() as patched:
        patched.setattr("ftcore.flight.execute", breaks)
        with pytest.raises(KeyboardInterrupt):
            sim.step()
    assert everything(sim) == before
    assert not sim.advance().subsystems["gps"].enabled


# ---- old documents


def test_given_a_document_of_before_then_it_loads_and_flies() -> None:
    old = {
        "system": "gps-receiver",
        "seed": 3,
        "duration": 20.0,
        "commands": [
            {"action": "inject", "time": 2.0, "fault": BIAS.model_dump(mode="json") | {"id": "f1", "start": 2.0}},
            {"action": "change", "time": 4.0, "fault": "f1", "fields": {"magnitude": 90.0}},
            {"action": "configure", "time": 5.0, "settings": {"false_alarm_probability": 0.01}},
            {"action": "switch", "time": 6.0, "subsystem": "gps", "enabled": False},
            {"action": "switch", "time": 8.0, "subsystem": "gps", "enabled": True},
            {"action": "clear", "time": 9.0, "fault": "f1"},
            {"action": "clear", "time": 9.0, "fault": None},
            {"action": "clear", "time": 10.0},
        ],
    }
    sim = Simulation(Scenario.model_validate(old)).advance()
    assert [e.kind for e in sim.events if e.run == -1][:4] == [
        "fault.injected", "fault.changed", "settings.changed", "subsystem.switched",
    ]  # fmt: skip
    assert sim.document() == Scenario.model_validate(old)
    with pytest.raises(ValidationError):
        Scenario.model_validate(old | {"commands": [{"time": 1.0, "subsystem": "gps", "enabled": False}]})
