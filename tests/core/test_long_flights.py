"""A long flight is made as it is flown: creating ten hours of it evaluates one block of its path, in little memory."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from ftcore import Scenario, Simulation
from ftcore.systems.redundant_imu import flight
from ftcore.systems.registry import SYSTEMS
from ftcore.world import path

HOURS = 36000.0
FLIGHTS = [(name, {}) for name in SYSTEMS] + [("sins-gps-bd2-cns", {"inertial": {"configuration": "redundant"}})]


def long_flight(system, parameters=None, duration=HOURS):
    return Scenario(system=system, duration=duration, parameters=parameters or {}, seed=36)


@pytest.fixture
def evaluated(monkeypatch):
    """Numbers of the blocks of paths and missions that were evaluated."""
    blocks = []
    for owner in (path.Path, flight.Mission):
        real = owner._evaluate
        monkeypatch.setattr(owner, "_evaluate", lambda self, n, real=real: (blocks.append(n), real(self, n))[1])
    return blocks


@pytest.mark.parametrize(("system", "parameters"), FLIGHTS)
def test_given_ten_hours_when_created_then_one_block_is_evaluated_in_less_than_50_megabytes(
    system, parameters, evaluated
):
    Simulation(long_flight(system, parameters, 10.0)).step()  # what is loaded and tabulated once is not the flight's
    evaluated.clear()
    tracemalloc.start()
    try:
        sim = Simulation(long_flight(system, parameters))
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < 50e6
    assert set(evaluated) <= {0}
    sim.advance(epochs=3)
    assert set(evaluated) <= {0}


@pytest.mark.parametrize(("system", "parameters"), FLIGHTS)
def test_given_a_longer_flight_then_its_beginning_has_the_bits_of_the_short_one(system, parameters):
    short, long = (
        Simulation(long_flight(system, parameters, duration)).advance(epochs=12) for duration in (12.0, HOURS)
    )
    for name in short.signals:
        np.testing.assert_array_equal(short[name], long[name], err_msg=name)


def test_given_a_mission_when_asked_in_any_order_then_the_same_is_wanted_and_the_height_is_the_climbs():
    from ftcore.systems.redundant_imu.forms import Flight, Leg
    from ftcore.world.aircraft import REGULATED, S, f16

    legs = (Leg(duration=5.0, climb_rate=120.0), Leg(duration=12.0, bank=45.0), Leg(duration=1.0, climb_rate=-20.0))
    forward, backward = (flight.mission(f16(), Flight(legs=legs)) for _ in range(2))
    epochs = range(0, 2500, 7)
    there = {epoch: forward.at(epoch) for epoch in epochs}
    for epoch in reversed(epochs):
        for one, other in zip(backward.at(epoch), there[epoch], strict=True):
            np.testing.assert_array_equal(one, other)
    # The climb rate goes over into the next in a smooth step: on average it changes in the middle of it.
    up = list(REGULATED).index(S.UP)
    feet, half = 0.3048, 0.5 * flight.CHANGE
    wanted = 1000.0 + 120.0 * feet * (5.0 + half) - 20.0 * feet * (45.0 - 17.0 - half)
    assert forward.at(2250)[0][up] == pytest.approx(wanted, abs=1e-3)
