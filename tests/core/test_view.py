"""Looking costs nothing: a picture of now flies no epoch again, and a picture is the same however it is come by."""

from __future__ import annotations

from typing import Any

import pytest

from ftcore import Fault, Scenario, Simulation
from ftcore.simulation import CHECKPOINTS

FAULT = Fault(channel="gps.pseudorange.D3", kind="bias", magnitude=80.0, start=20.0)


@pytest.fixture
def flight() -> Simulation:
    scenario = Scenario.load("chey-2004").model_copy(update={"duration": 300.0, "faults": ()})
    return Simulation(scenario, seed=3)


def counted(simulation: Simulation, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Epochs that a simulation flies from now on."""
    flown: list[int] = []
    fly = Simulation._fly

    def noted(self: Simulation, state: Any, operator: Any) -> Any:
        flown.append(state.epoch + 1)
        return fly(self, state, operator)

    monkeypatch.setattr(Simulation, "_fly", noted)
    return flown


def test_a_view_of_now_flies_nothing(flight: Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    flown = counted(flight, monkeypatch)
    flight.view()
    assert flown == []
    flight.advance(epochs=3 * CHECKPOINTS + 1)
    flown.clear()
    for _ in range(3):
        flight.inject(FAULT.model_copy(update={"start": None}))
        flight.view()
        flight.view(flight.now)
    flight.fork().view()
    assert flown == []


def test_after_a_rewind_or_a_branch_the_picture_is_made_at_most_once(
    flight: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight.advance(epochs=3 * CHECKPOINTS)
    flown = counted(flight, monkeypatch)
    for branch in (flight.fork(at=101.0), flight.rewind(to=101.0)):
        branch.view()
        flown.clear()
        branch.view()
        assert flown == []


@pytest.mark.parametrize("at", [0.0, 1.0, 19.0, 20.0, 64.0, 101.0, 130.0])
def test_a_picture_is_the_same_at_once_later_after_a_rewind_and_in_a_branch(flight: Simulation, at: float) -> None:
    flight.inject(FAULT)
    flight.advance(until=at)
    at_once = flight.view()
    flight.advance(until=140.0)
    assert flight.view(at) == at_once
    assert flight.fork(at=at).view() == at_once
    now = flight.view()
    flight.rewind(to=at)
    assert flight.view() == at_once
    assert flight.view() == at_once
    flight.advance(until=140.0)
    assert flight.view() == now


def test_what_is_shown_after_flying_on_is_the_new_future(flight: Simulation) -> None:
    flight.advance(until=60.0)
    healthy = flight.view()
    flight.rewind(to=30.0)
    flight.inject(FAULT.model_copy(update={"start": None}))
    flight.advance(until=60.0)
    assert flight.view() != healthy
