"""Whatever the forms allow can be set in flight, with whatever faults the schema allows: no flight fails of it.

Drawn by a seed: settings at their bounds, between them and near zero; every kind of fault, from a thousandth to the
largest magnitude of its channel.
"""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
import pytest

from ftcore import CommandError, FlightError, Simulation
from ftcore.faults import largest
from tests.core.test_every_fault_acts import SETTINGS, base, pairs
from tests.faulting import lay, sized

EPOCHS = 8


def drawn(rng: np.random.Generator, field: dict[str, Any]) -> Any:
    """A value that a field of a form takes: a bound, or something between."""
    if "enum" in field:
        return field["enum"][int(rng.integers(len(field["enum"])))]
    if field["type"] == "boolean":
        return bool(rng.integers(2))
    low = field.get("minimum", field.get("exclusiveMinimum", 0.0))
    high = field["maximum"]
    if field["type"] == "integer":
        return int((low, high, rng.integers(low, high + 1))[int(rng.integers(3))])
    low = low if "minimum" in field else 1e-9 * high
    between = float(np.exp(rng.uniform(np.log(max(low, 1e-12)), np.log(high))))
    return float((low, high, min(max(between, low), high), rng.uniform(low, high))[int(rng.integers(4))])


def disturb(simulation: Simulation, rng: np.random.Generator) -> None:
    """Some epochs in which anybody may set anything and break anything."""
    form = simulation.scenario.model.Settings.model_json_schema()["properties"]
    every = pairs(simulation)
    for _ in range(EPOCHS):
        if rng.random() < 0.5:
            names = rng.choice(sorted(form), min(3, len(form)), replace=False).tolist()
            # Settings may contradict each other; then nothing has changed.
            with contextlib.suppress(CommandError):
                simulation.configure(**{name: drawn(rng, form[name]) for name in names})
        if rng.random() < 0.5:
            channel, kind = every[int(rng.integers(len(every)))]
            most = largest(kind, channel.unit) or 0.0  # type: ignore[arg-type]
            size = most * float(rng.choice([1.0, 10.0 ** rng.uniform(-9.0, 0.0)]))
            if kind not in ("noise", "random-walk", "delay"):
                size *= float(rng.choice([-1.0, 1.0]))
            lay(simulation, sized(channel.name, kind, size, rate=1.0))  # type: ignore[arg-type]
        simulation.step()
    simulation.view()
    simulation.score()


def fly(name: str, cases: range, folder: str) -> list[str]:
    """The cases in which the flight failed, with the reason."""
    failed = []
    for case in cases:
        flight = base(name, folder).fork()
        try:
            with np.errstate(all="ignore"):
                disturb(flight, np.random.default_rng([6, case]))
        except FlightError as error:
            failed.append(f"case {case}: {error.reason}")
    return failed


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", SETTINGS)
def test_given_any_settings_and_any_faults_then_the_flight_goes_on(name, tmp_path_factory):
    assert fly(name, range(5), str(tmp_path_factory.mktemp("log"))) == []


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", SETTINGS)
def test_given_many_settings_and_faults_then_no_flight_fails(name, tmp_path_factory):
    assert fly(name, range(5, 205), str(tmp_path_factory.mktemp("log"))) == []


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("bound", ["minimum", "maximum"])
def test_given_a_setting_at_its_bound_then_the_flight_goes_on(name, bound, tmp_path_factory):
    simulation = base(name, str(tmp_path_factory.mktemp("log")))
    for field, schema in simulation.scenario.model.Settings.model_json_schema()["properties"].items():
        for value in [*schema.get("enum", []), *([schema[bound]] if bound in schema else [])]:
            flight = simulation.fork()
            with contextlib.suppress(CommandError):
                flight.configure(**{field: value})
            flight.advance(epochs=2)
