"""Every kind of fault on every channel of every system acts, or is refused, or says why it is silent.

Each pair of channel and kind is flown beside a twin from the same moment that nobody touches. A fault acts exactly if
the two flights differ in a bit of what is recorded. Nothing here is random but the sample of the quick version.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

from ftcore import CommandError, Scenario, Simulation
from ftcore.description import Channel
from ftcore.faults import KINDS
from tests.faulting import sized
from tests.synthetic_log import files

EPOCHS = 4
"""Flown with each fault."""
SAMPLE = 30
"""Pairs of each flight in the quick version."""


@dataclass(frozen=True)
class Setting:
    """A flight to break, from when [s], and with what on top of its scenario."""

    scenario: str
    at: float
    changes: dict[str, Any]


SETTINGS = {
    "A": Setting("zhang-1992", 20.0, {}),
    "A satellite integrity": Setting("zhang-1992", 20.0, {"settings": {"satellite_integrity": "snapshot"}}),
    "B": Setting("chey-2004", 20.0, {}),
    "B log": Setting("log", 600.0, {}),
    "C": Setting("yang-2016-scenario-1", 20.0, {}),
    "C redundant": Setting("yang-2016-scenario-1", 20.0, {"parameters": {"inertial": {"configuration": "redundant"}}}),
    "D": Setting("kim-2005", 0.5, {}),
}


@cache
def base(name: str, folder: str) -> Simulation:
    """The flight up to the moment from which it is broken."""
    setting = SETTINGS[name]
    if setting.scenario == "log":
        from pathlib import Path

        from ftcore.systems.gps_receiver.logs import log_scenario

        made = files(40, 30.0)
        paths = [Path(folder) / "a.26o", Path(folder) / "a.26n"]
        for path, content in zip(paths, (made.observation, made.navigation), strict=True):
            path.write_bytes(content)
        given = log_scenario(*map(str, paths))
    else:
        given = Scenario.load(setting.scenario).model_dump(mode="json") | {"faults": [], "duration": 60.0}
    for field, value in setting.changes.items():
        given[field] = given.get(field, {}) | value
    return Simulation(Scenario.model_validate(given)).advance(until=setting.at)


def pairs(simulation: Simulation) -> list[tuple[Channel, str]]:
    """All channels that this flight has, with all kinds they take."""
    return [
        (channel, kind)
        for channel in simulation.description.channels
        if channel.name not in simulation.unavailable
        for kind in channel.kinds
    ]


def broken(simulation: Simulation, channel: Channel, kind: str) -> tuple[str, Simulation | None, str]:
    """acting, explained or refused; the flight, if there is one; and what was said."""
    size = {"delay": 1.5, "scale-factor": 0.01, "outliers": channel.typical}.get(kind, channel.typical)
    flight = simulation.fork()
    try:
        fault = flight.inject(sized(channel.name, kind, size, rate=0.5))  # type: ignore[arg-type]
    except CommandError as refused:
        return "refused", None, str(refused)
    flight.advance(epochs=EPOCHS)
    live = next(live for live in flight.faults if live.fault.id == fault.id)
    assert live.acted_epochs == flight.acted[str(fault.id)].epochs[0]
    if live.acted_epochs:
        assert live.acting == (live.silent_because is None)
        return "acting", flight, ""
    assert live.silent_because
    return "explained", flight, live.silent_because


def sweep(name: str, chosen: list[tuple[Channel, str]], folder: str) -> tuple[Counter[str], list[str]]:
    """What became of these pairs, and which of them contradict the twin."""
    simulation = base(name, folder)
    calm = simulation.fork().advance(epochs=EPOCHS).recording.rows
    found: Counter[str] = Counter()
    wrong = []
    for channel, kind in chosen:
        outcome, flight, said = broken(simulation, channel, kind)
        found[outcome] += 1
        if flight is not None:
            differs = not np.array_equal(flight.recording.rows, calm, equal_nan=True)
            if differs != (outcome == "acting"):
                wrong.append(f"{channel.name} {kind}: {outcome}, differs {differs}; {said}")
    return found, wrong


@pytest.mark.parametrize("name", SETTINGS)
def test_given_a_fault_on_a_channel_then_it_acts_or_is_refused_or_says_why_not(name, tmp_path_factory):
    folder = str(tmp_path_factory.mktemp("log"))
    every = pairs(base(name, folder))
    rng = np.random.default_rng(10)
    chosen = [every[i] for i in rng.choice(len(every), min(SAMPLE, len(every)), replace=False)]
    found, wrong = sweep(name, chosen, folder)
    assert not wrong
    assert found["acting"] > 0


@pytest.mark.long
@pytest.mark.parametrize("name", SETTINGS)
def test_given_every_kind_on_every_channel_then_each_acts_or_is_refused_or_says_why_not(name, tmp_path_factory, capsys):
    folder = str(tmp_path_factory.mktemp("log"))
    every = pairs(base(name, folder))
    assert {kind for _, kind in every} == set(KINDS)
    found, wrong = sweep(name, every, folder)
    with capsys.disabled():
        print(f"\n{name}: {len(every)} pairs, {dict(found)}")
    assert not wrong
    assert sum(found.values()) == len(every)


@pytest.mark.parametrize("name", SETTINGS)
def test_given_a_subsystem_that_is_switched_off_then_no_fault_of_it_acts_and_each_says_so(name, tmp_path_factory):
    simulation = base(name, str(tmp_path_factory.mktemp("log")))
    rng = np.random.default_rng(11)
    for subsystem in simulation.subsystems:
        off = simulation.fork().switch(subsystem, False)
        calm = off.fork().advance(epochs=EPOCHS).recording.rows
        here = [pair for pair in pairs(simulation) if f"{pair[0].sensor}.".startswith(f"{subsystem}.")]
        for i in rng.choice(len(here), min(8, len(here)), replace=False):
            outcome, flight, said = broken(off, *here[i])
            assert outcome in ("explained", "refused")
            if flight is not None:
                assert said == f"{subsystem} is switched off"
                assert np.array_equal(flight.recording.rows, calm, equal_nan=True), here[i]


def together(simulation: Simulation) -> list[tuple[Channel, Channel]]:
    """Two channels of one instrument or of one satellite each, that have a reading."""
    blind = {*simulation.not_in_view, *simulation.unavailable}
    there = [c for c in simulation.description.channels if c.name not in blind and len(c.parts) < 4]

    def alike(a: Channel, b: Channel) -> bool:
        axis = a.name[:-1] == b.name[:-1] or a.name.split(".")[-1] == b.name.split(".")[-1]
        return a.name.split(".")[0] == b.name.split(".")[0] and axis

    return [(a, b) for a in there for b in there if a.name != b.name and alike(a, b)]


@pytest.mark.parametrize("name", ["A", "C redundant", "D"])
def test_given_a_dropout_beside_it_then_a_fault_acts_or_says_that_nobody_uses_its_reading(name, tmp_path_factory):
    simulation = base(name, str(tmp_path_factory.mktemp("log")))
    rng = np.random.default_rng(12)
    every = together(simulation)
    for i in rng.choice(len(every), min(8, len(every)), replace=False):
        gone, faulted = every[i]
        twin = simulation.fork()
        twin.inject(sized(gone.name, "dropout", 0.0))
        outcome, flight, said = broken(twin, faulted, "bias")
        calm = twin.advance(epochs=EPOCHS).recording.rows
        assert flight is not None
        differs = not np.array_equal(flight.recording.rows, calm, equal_nan=True)
        assert differs == (outcome == "acting"), (gone.name, faulted.name, said)
        if outcome == "explained":
            assert "other axis" in said or "dropout" in said


def test_given_a_gyro_without_one_axis_then_its_other_axis_is_silent_until_the_dropout_ends(tmp_path_factory):
    flight = base("D", str(tmp_path_factory.mktemp("log"))).fork()
    flight.inject(sized("imu.gyro.1x", "dropout", 0.0, end=flight.now + 0.2))
    fault = flight.inject(sized("imu.gyro.1y", "bias", 0.1))
    flight.advance(epochs=5)
    gone, silent = flight.faults
    assert gone.acting
    assert not silent.acting
    assert (
        silent.silent_because == "its instrument has no reading of the other axis, and is used with both or not at all"
    )
    flight.advance(epochs=10)
    assert next(live for live in flight.faults if live.fault.id == fault.id).acting
