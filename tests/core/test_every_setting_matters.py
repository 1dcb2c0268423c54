"""Every setting and every parameter matters, or is refused with what would make it matter.

Each setting is changed in flight, in each choice of the other settings, and flown beside a twin that keeps it, through
the same faults of every sensor. It matters exactly if the two differ in a bit of what is recorded or in an event. What
is refused is set by force: then nothing may differ, or the refusal were wrong. Parameters are flown from the start.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from ftcore import CommandError, Scenario, Simulation
from tests.core.test_every_fault_acts import SETTINGS, base
from tests.faulting import lay, sized

REFUSAL = "changes nothing here"
EPOCHS = 90
"""Flown at most; a pair that differs is not flown on."""
SAMPLE = 2
"""Settings of each flight in the quick version, each in one choice of the others."""

TROUBLE: Mapping[str, tuple[tuple[str, str, float, int, int], ...]] = {
    "sins-gps-doppler": (
        ("gps.pseudorange.#0", "bias", 3.0, 2, 9),
        ("doppler.velocity.all", "bias", 0.4, 10, 16),
        ("doppler.velocity.all", "bias", 5.0, 17, 24),
        ("gps.pseudorange.all", "ramp", 1.0, 26, 36),
        ("altimeter.height.up", "bias", 3.0, 38, 44),
        ("imu.gyro.1x", "bias", 30.0, 46, 54),
        ("imu.accelerometer.2x", "dropout", 1.0, 56, 75),
        ("imu.accelerometer.3y", "bias", 30.0, 60, 70),
        ("doppler.velocity.y", "outliers", 1.0, 72, 90),
    ),
    "gps-receiver": (
        ("gps.pseudorange.#0", "bias", 1.5, 2, 12),
        ("gps.pseudorange.#0", "ramp", 0.1, 15, 27),
        ("gps.pseudorange.all", "bias", 3.0, 28, 36),
        ("gps.pseudorange.#0", "noise", 0.7, 38, 60),
        ("gps.pseudorange.#0", "outliers", 1.2, 62, 90),
    ),
    "B log": (
        ("gps.pseudorange.#2", "noise", 0.07, 2, 16),
        ("gps.pseudorange.all", "bias", 10.0, 18, 22),
        ("gps.pseudorange.#0", "outliers", 0.2, 24, 30),
        *((f"gps.pseudorange.#{k}", "dropout", 1.0, 31, 37) for k in (1, 2, 3)),
        ("gps.pseudorange.#0", "bias", 10.0, 32, 36),
    ),
    "sins-gps-bd2-cns": (
        ("gps.position.all", "bias", 0.5, 2, 7),
        ("gps.position.all", "bias", 4.0, 8, 18),
        ("bd2.position.all", "bias", 4.0, 14, 24),
        ("cns.attitude.all", "bias", 20.0, 26, 36),
        ("gps.position.all", "dropout", 1.0, 38, 41),
        ("bd2.position.all", "dropout", 1.0, 38, 41),
        ("cns.attitude.all", "dropout", 1.0, 38, 41),
        ("imu.gyro.1x", "bias", 30.0, 43, 52),
        ("imu.accelerometer.2x", "dropout", 1.0, 54, 75),
        ("imu.accelerometer.3y", "bias", 30.0, 58, 70),
    ),
    "redundant-imu": (
        ("imu.gyro.3x", "outliers", 1.0, 1, 14),
        ("imu.gyro.1x", "bias", 1.0, 16, 32),
        ("imu.gyro.1y", "bias", 1.0, 16, 32),
        ("imu.gyro.2x", "dropout", 1.0, 40, 60),
        ("imu.gyro.3x", "dropout", 1.0, 45, 50),
        ("imu.gyro.3y", "bias", 1.0, 65, 75),
    ),
}
"""Faults by flight or system: channel (#k is the k-th that has a reading), kind, size in typical magnitudes, epochs."""


@cache
def healthy(name: str, folder: str) -> Simulation:
    """A flight without a fault, with room for those to come.

    A log of half a minute an epoch is short, so it is taken near its start; and its filter is made to remember, or it
    would say what the snapshot says.
    """
    given = base(name, folder).scenario.model_dump(mode="json")
    if name == "B log":
        given["parameters"]["filter"] = {"position_noise": 1e-6, "clock_frequency_noise": 1e-9}
        return Simulation(Scenario.model_validate(given)).advance(until=60.0)
    return Simulation(Scenario.model_validate(given | {"duration": 120.0})).advance(until=SETTINGS[name].at)


def troubled(simulation: Simulation, name: str = "") -> Simulation:
    """A twin with the faults of this flight or its system laid from now on."""
    flight = simulation.fork()
    channels = {channel.name: channel for channel in flight.description.channels}
    blind = {*flight.not_in_view, *flight.unavailable}
    now, period = flight.now, flight.period
    for pattern, kind, size, first, last in TROUBLE.get(name) or TROUBLE[flight.description.id]:
        stem, _, place = pattern.partition("#")
        heard = [n for n in channels if n.startswith(stem) and n not in blind]
        channel = heard[int(place)] if place else pattern
        start, end = now + first * period, now + last * period
        if channel not in flight.unavailable and start < flight.duration:
            magnitude = size * channels[channel].typical
            lay(flight, sized(channel, kind, magnitude, rate=0.25, start=start, end=end))  # type: ignore[arg-type]
    return flight


def said(flight: Simulation, before: int) -> list[tuple[float, str, str]]:
    """Events since the first ``before``, but for those that say that a setting was changed."""
    return [(e.time, e.kind, e.subject) for e in flight.events[before:] if e.kind != "settings.changed"]


class Twin:
    """What a flight records and says that keeps its settings, flown as far as anybody asks."""

    def __init__(self, start: Simulation) -> None:
        self.start = start
        self.flight = start.fork()
        self._rows: list[np.ndarray] = []

    def row(self, k: int) -> np.ndarray:
        """The ``k``-th row from the start."""
        while len(self._rows) <= k:
            self.flight.step()
            self._rows.append(np.array(list(self.flight.latest().values())))
        return self._rows[k]

    def differs(self, other: Simulation) -> bool:
        """Whether the other flight records or says something else."""
        before = len(self.start.events)
        for k in range(EPOCHS):
            if other.finished:
                break
            other.step()
            if not np.array_equal(np.array(list(other.latest().values())), self.row(k), equal_nan=True):
                return True
        return said(other, before) != said(self.flight, before)


def others(schema: Mapping[str, Any], now: Any) -> list[Any]:
    """Values to try in place of this one: every other choice, the bounds, and some between."""
    if "enum" in schema:
        values = list(schema["enum"])
    elif schema["type"] == "boolean":
        values = [True, False]
    else:
        low, high = schema.get("minimum", schema.get("exclusiveMinimum", 0.0)), schema["maximum"]
        between = [now * 2, now / 2] if schema["type"] == "number" else [now + 1, now * 2]
        values = [*(v for v in between if low < v < high), *([low] if "minimum" in schema else []), high]
    return [value for value in values if value != now]


def choices(name: str, folder: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Choices of the settings: as by default, each other value of each enumeration, and no test that drives."""
    form = base(name, folder).scenario.model.Settings.model_json_schema()["properties"]
    now = base(name, folder).settings
    yield "default", {}
    for field, schema in form.items():
        if "enum" in schema or schema["type"] == "boolean":
            for value in others(schema, now[field]):
                yield f"{field}={value}", {field: value}
    drivers = [field for field in form if field.endswith("driving_test")]
    if len(drivers) > 1:
        yield "nobody drives", dict.fromkeys(drivers, "none")


def outcome(twin: Twin, field: str, schema: Mapping[str, Any], monkeypatch: pytest.MonkeyPatch) -> str:
    """matters, refused, or what is wrong."""
    tried = refused = 0
    form = twin.start.scenario.model.Settings
    for value in others(schema, twin.start.settings[field]):
        flight = twin.start.fork()
        try:
            flight.configure(**{field: value})
        except CommandError as error:
            if REFUSAL not in str(error):
                continue
            refused += 1
            with monkeypatch.context() as forced:
                forced.setattr(form, "without_effect", lambda *_: {})
                flight.configure(**{field: value})
                if twin.differs(flight):
                    return f"{value} is refused, but it matters"
            continue
        tried += 1
        if twin.differs(flight):
            return "matters"
    if tried:
        return "is accepted, but changes nothing"
    return "refused" if refused else "takes no other value"


def sweep(name: str, folder: str, chosen: int | None, monkeypatch: pytest.MonkeyPatch) -> tuple[int, list[str]]:
    """How many settings were refused, and what is wrong; a sample by a seed, or all of them."""
    form = base(name, folder).scenario.model.Settings.model_json_schema()["properties"]
    # Over how many epochs alarms are counted shows only where they come apart; not every driving test's do so here.
    cases = [
        (label, choice, field)
        for label, choice in choices(name, folder)
        for field in form
        if field != "within" or label in ("default", "nobody drives")
    ]
    if chosen is not None:
        rng = np.random.default_rng(12)
        cases = [cases[i] for i in sorted(rng.choice(len(cases), min(chosen, len(cases)), replace=False))]
    refused, wrong = 0, []
    twins: dict[str, Twin] = {}
    for label, choice, field in cases:
        if label not in twins:
            start = troubled(healthy(name, folder), name)
            try:
                start.configure(**choice)
            except CommandError as error:
                if REFUSAL not in str(error):
                    raise
                continue
            twins[label] = Twin(start)
        found = outcome(twins[label], field, form[field], monkeypatch)
        refused += found == "refused"
        if found not in ("matters", "refused"):
            wrong.append(f"{label}: {field} {found}")
    return refused, wrong


LISTS: Mapping[str, list[dict[str, Any]]] = {
    "legs": [{"duration": 1.0, "bank": 10.0}],
    "phases": [{"intensity": "low", "duration": 30.0}],
    "segments": [{"kind": "turn", "angle": 90.0, "bank": 20.0}],
}
"""Other values of the parameters that are lists."""
REDUNDANT = {"inertial": {"configuration": "redundant"}}
IDLE: tuple[tuple[str, dict[str, Any], dict[str, Any], dict[str, Any], str], ...] = (
    ("yang-2016-scenario-1", {}, {}, {"imu_driving_test": "parity"}, "inertial.configuration = 'redundant'"),
    ("yang-2016-scenario-1", {}, {}, {"fusion_mode": "rescale"}, "master = 'federated'"),
    ("yang-2016-scenario-1", {}, {"master": "federated"}, {"exclusion": "isolation"}, "master = 'tolerant'"),
    ("yang-2016-scenario-1", {}, {"driving_test": "none"}, {"doubt_probability": 0.3}, "driving_test"),
    ("yang-2016-scenario-1", {}, {"driving_test": "none"}, {"recovery": "both"}, "driving_test"),
    ("yang-2016-scenario-1", {}, {"driving_test": "none"}, {"exclusion": "isolation"}, "driving_test"),
    ("yang-2016-scenario-1", {}, {"driving_test": "none"}, {"hold_off": 9}, "driving_test"),
    (
        "yang-2016-scenario-1",
        REDUNDANT,
        {"driving_test": "none", "imu_driving_test": "none"},
        {"confirm": 2},
        "driving_test",
    ),
    ("zhang-1992", {}, {}, {"doubt_probability": 0.3}, "master = 'tolerant'"),
    ("zhang-1992", {}, {}, {"wrong_isolation_probability": 0.1}, "satellite_integrity = 'snapshot'"),
    ("kim-2005", {}, {"hybrid": False}, {"lead": 5}, "hybrid = true"),
    ("kim-2005", {}, {"driving_test": "none"}, {"hold_off": 9}, "driving_test"),
)
"""Scenario, parameters and settings in which a further setting is without effect, and what would bring it to bear."""


def shown(scenario: str, parameters: dict[str, Any], settings: dict[str, Any]) -> Scenario:
    """The scenario without faults, with these parameters and settings."""
    given = Scenario.load(scenario).model_dump(mode="json") | {"faults": [], "duration": 5.0}
    return Scenario.model_validate(given | {"parameters": parameters, "settings": settings})


@pytest.mark.parametrize(("scenario", "parameters", "settings", "idle", "remedy"), IDLE)
def test_given_a_setting_without_effect_then_start_and_flight_refuse_it_and_name_the_remedy(
    scenario, parameters, settings, idle, remedy
):
    with pytest.raises(ValidationError) as at_start:
        shown(scenario, parameters, settings | idle)
    (name,) = idle
    (found,) = at_start.value.errors()
    assert found["loc"] == ("settings", name)
    assert REFUSAL in found["msg"]
    assert remedy in found["msg"]
    flight = Simulation(shown(scenario, parameters, settings))
    before = flight.settings
    with pytest.raises(CommandError, match=REFUSAL) as in_flight:
        flight.configure(**idle)
    assert in_flight.value.field == name
    assert remedy in str(in_flight.value)
    assert flight.settings == before
    assert remedy in flight.idle_settings[name]


def test_given_what_brings_a_setting_to_bear_then_both_are_taken_at_once_and_its_value_outlives_it():
    flight = Simulation(shown("zhang-1992", {}, {}))
    flight.configure(master="tolerant", doubt_probability=0.3)
    assert "doubt_probability" not in flight.idle_settings
    flight.configure(master="federated")
    assert flight.settings["doubt_probability"] == 0.3
    assert "doubt_probability" in flight.idle_settings
    flight.configure(doubt_probability=0.3, confirm=1)  # as it is already
    flight.advance(epochs=2)
    assert (
        Simulation(Scenario.model_validate(flight.document().model_dump(mode="json"))).advance(epochs=2).settings
        == flight.settings
    )


def test_given_somebody_isolated_then_how_he_comes_back_may_be_set_though_no_test_drives():
    flight = Simulation(Scenario.load("kim-2005").model_copy(update={"faults": ()}))
    flight.inject(sized("imu.gyro.1x", "bias", 0.5))
    flight.advance(epochs=10)
    assert flight.subsystems["imu.gyro.1"].health == "isolated"
    flight.configure(driving_test="none")
    assert flight.configure(hold_off=9)["hold_off"] == 9


@pytest.mark.parametrize(
    ("scenario", "parameters", "at"),
    [
        ("yang-2016-scenario-1", {"inertial": {"mounting": [40.0, 45.0, 45.0]}}, ("inertial", "mounting")),
        ("yang-2016-scenario-1", {"inertial": {"calibration": 30.0}}, ("inertial", "calibration")),
        (
            "yang-2016-scenario-1",
            {"flight": {"phases": [{"intensity": "low"}], "high_bank": 20.0}},
            ("flight", "high_bank"),
        ),
        (
            "yang-2016-scenario-1",
            {"flight": {"segments": LISTS["segments"], "low_bank": 4.0}},
            ("flight", "low_bank"),
        ),
        (
            "chey-2004",
            {"log": {"observation": "a", "navigation": "b"}, "receiver": {"height": 9.0}},
            ("receiver", "height"),
        ),
        ("kim-2005", {"plant": "jsbsim", "mismatch": {"mass": 9.0}}, ("mismatch",)),
    ],
)
def test_given_a_parameter_without_effect_then_it_is_refused_at_its_place(scenario, parameters, at):
    with pytest.raises(ValidationError) as refused:
        shown(scenario, parameters, {})
    (found,) = refused.value.errors()
    assert found["loc"] == ("parameters", *at)


def test_given_values_as_by_default_then_a_whole_form_is_taken():
    for name in ("zhang-1992", "chey-2004", "kim-2005", "yang-2016-scenario-1"):
        system = Scenario.load(name).model
        parameters = system.Parameters().model_dump(mode="json", exclude_none=True)
        shown(name, parameters, system.Settings().model_dump(mode="json"))


@pytest.mark.parametrize("name", ["B", "D"])
def test_given_a_setting_changed_in_flight_then_it_matters_or_is_refused(name, tmp_path_factory, monkeypatch):
    _, wrong = sweep(name, str(tmp_path_factory.mktemp("log")), SAMPLE, monkeypatch)
    assert not wrong


@pytest.mark.long
@pytest.mark.parametrize("name", SETTINGS)
def test_given_every_setting_in_every_choice_of_the_others_then_it_matters_or_is_refused(
    name, tmp_path_factory, monkeypatch, capsys
):
    refused, wrong = sweep(name, str(tmp_path_factory.mktemp("log")), None, monkeypatch)
    with capsys.disabled():
        print(f"\n{name}: {refused} refused")
    assert not wrong


FLIGHTS: Mapping[str, tuple[str, dict[str, Any]]] = {
    "A": ("zhang-1992", {}),
    "B": ("chey-2004", {}),
    "B log": ("log", {}),
    "C": (
        "yang-2016-scenario-1",
        {"flight": {"speed": 60.0, "phases": [{"intensity": "high", "duration": 40.0}]}},
    ),
    "C redundant": (
        "yang-2016-scenario-1",
        {
            "inertial": {"configuration": "redundant"},
            "flight": {"speed": 60.0, "phases": [{"intensity": "low", "duration": 110.0}]},
        },
    ),
    "C segments": ("yang-2016-scenario-1", {"flight": {"segments": [{"kind": "straight", "duration": 9.0}]}}),
    "D": ("kim-2005", {"flight": {"legs": [{"duration": 0.5, "climb_rate": 60.0}]}}),
}
"""Scenario and parameters in whose company each parameter is changed; what comes late in a flight comes early here."""


def flown(name: str, folder: str, parameters: dict[str, Any]) -> Simulation:
    """The flight from the start, with its faults. Raises ValidationError where a parameter is refused."""
    scenario = FLIGHTS[name][0]
    given = base("B log", folder).scenario if scenario == "log" else Scenario.load(scenario)
    document = given.model_dump(mode="json") | {"faults": [], "parameters": parameters, "duration": 100.0}
    document["duration"] = min(document["duration"], 15.0) if name == "D" else document["duration"]
    return troubled(Simulation(Scenario.model_validate(document)), name)


def leaves(
    schema: Mapping[str, Any], root: Mapping[str, Any], path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """Paths and schemas of all parameters that are no group of others."""
    for field, inside in schema["properties"].items():
        inside = next((s for s in inside.get("anyOf", [inside]) if s.get("type") != "null"), inside)
        if "$ref" in inside:
            inside = root["$defs"][inside["$ref"].rsplit("/", 1)[-1]] | {k: v for k, v in inside.items() if k != "$ref"}
        if "properties" in inside:
            yield from leaves(inside, root, (*path, field))
        else:
            yield (*path, field), inside


def changed(path: tuple[str, ...], schema: Mapping[str, Any], now: Any) -> list[Any]:
    """Other values of a parameter."""
    if path[-1] in LISTS:
        return [LISTS[path[-1]]]
    if "prefixItems" in schema:
        return [[now[0] + 3.0, *now[1:]]] if now else [[-3026000.0, 4068000.0, 3857000.0]]
    if "enum" in schema:
        return [value for value in schema["enum"] if value != now]
    if path[-1] == "mask":
        return [30.0]  # a little more leaves the same satellites
    low, high = schema["minimum"], schema["maximum"]
    return [next(v for v in (now * 1.3, now / 1.3, 0.01 * high) if low <= v <= high and v != now)]


def with_value(parameters: Mapping[str, Any], path: tuple[str, ...], value: Any) -> dict[str, Any]:
    """The parameters with another value in one place."""
    first, *rest = path
    inner = with_value(parameters.get(first) or {}, tuple(rest), value) if rest else value
    return {**parameters, first: inner}


def idle_parameters(name: str, folder: str) -> tuple[list[str], list[str]]:
    """Parameters of a flight that are refused, and those that change nothing."""
    given = dict(FLIGHTS[name][1])
    if FLIGHTS[name][0] == "log":
        given = dict(base("B log", folder).scenario.parameters)
    start = flown(name, folder, given)
    twin, system = Twin(start), start.scenario.model
    schema = system.Parameters.model_json_schema()
    whole = system.Parameters.model_validate(given).model_dump(mode="json")
    refused, idle = [], []
    for path, field in leaves(schema, schema):
        at: Any = whole
        for part in path:
            at = None if at is None else at[part]
        if path[-1] in ("observation", "navigation") or (path[0] == "log" and whole["log"] is None):
            continue
        label = f"{name}: {'.'.join(path)}"
        for value in changed(path, field, at):
            try:
                other = flown(name, folder, with_value(given, path, value))
            except (ValidationError, CommandError) as error:
                if REFUSAL not in str(error) and "JSBSim" not in str(error):
                    raise
                refused.append(label)
                continue
            # Where the satellites stand shows in the scene alone, as positions are the sensors' own.
            if not twin.differs(other) and other.view() == twin.flight.view():
                idle.append(label)
    return refused, idle


@pytest.mark.long
@pytest.mark.parametrize("name", FLIGHTS)
def test_given_a_parameter_changed_at_the_start_then_it_matters_or_is_refused(name, tmp_path_factory):
    _, idle = idle_parameters(name, str(tmp_path_factory.mktemp("log")))
    assert not idle
