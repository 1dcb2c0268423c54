"""JSBSim's F-16 as the aircraft: it flies the mission, to the same bits; the gyro at fault is named all the same."""

import sys

import numpy as np
import pytest
from pydantic import ValidationError

from ftcore import Scenario, Simulation, catalogue
from ftcore.simulation import CommandError
from ftcore.world.aircraft import FOOT, S, derivative, f16, steady_thrust, trim
from tests.redundant_imu import bias, pair, scenario

pytest.importorskip("jsbsim", reason="jsbsim is not installed")
from ftcore.world.aircraft import jsbsim_f16
from ftcore.world.aircraft.jsbsim_f16 import Start

START = Start(502 * FOOT, 1000.0, 120 * FOOT, 0.3, 0.02)
JSBSIM = {"plant": "jsbsim"}


def fly(flown, sticks):
    for stick in sticks:
        flown = jsbsim_f16.step(flown, stick)
    return flown


def some_sticks(steps, count=2, seed=1):
    return np.array([0.35, 0.0, 0.0, 0.0]) + 0.05 * np.random.default_rng(seed).normal(size=(steps, count, 4))


def test_it_begins_in_the_steady_flight_that_is_asked_for_and_goes_on_so():
    flown = jsbsim_f16.begin(START, 1)
    (aircraft,) = flown.live[0]
    held = np.array([[aircraft["fcs/throttle-cmd-norm"], 0.0, 0.0, 0.0]])
    after = fly(flown, [held] * 100)
    x, y = flown.x[0], after.x[0]
    np.testing.assert_allclose(x[[S.SPEED, S.HEADING, S.UP]], [START.speed, 0.3, 1000.0], rtol=1e-9)
    assert y[S.UP] - x[S.UP] == pytest.approx(2.0 * START.climb_rate, rel=0.01)
    way = np.hypot(y[S.EAST], y[S.NORTH])
    assert way == pytest.approx(2.0 * np.sqrt(START.speed**2 - START.climb_rate**2), rel=0.01)
    assert np.arctan2(y[S.EAST], y[S.NORTH]) == pytest.approx(0.3, abs=0.01)
    np.testing.assert_allclose(y[[S.SPEED, S.ALPHA, S.PITCH]], x[[S.SPEED, S.ALPHA, S.PITCH]], rtol=0.02)


def test_it_is_an_f16_but_not_ours():
    """Two models from the same wind tunnel: our accelerations where JSBSim's balance are small, and not nothing."""
    flown = jsbsim_f16.begin(START, 1)
    ours = trim(f16(), START.speed, START.height, START.climb_rate)
    x, u = flown.x[0].copy(), ours.u.copy()
    x[S.POWER], u[1:] = ours.x[S.POWER], flown.surfaces[0]
    dx = derivative(f16(), x, u)
    assert abs(dx[S.SPEED]) < 0.1
    assert abs(dx[S.ALPHA]) < 0.01
    assert 0.02 < abs(dx[S.Q]) < 0.2
    assert x[S.ALPHA] == pytest.approx(ours.x[S.ALPHA], abs=np.deg2rad(0.3))


@pytest.mark.parametrize(
    ("stick", "size", "rate"), [(1, -0.3, S.Q), (2, 0.3, S.P), (3, 0.3, S.R)], ids=["back", "right", "left pedal"]
)
def test_surfaces_have_the_signs_of_the_tables(stick, size, rate):
    """What JSBSim does with its surface, the published aircraft does with the one that is read back."""
    told = np.array([[0.35, 0.0, 0.0, 0.0]])
    told[0, stick] = size
    start = jsbsim_f16.begin(START, 1)
    flown = fly(start, [told] * 10)
    x = trim(f16(), START.speed, START.height, START.climb_rate).x
    u = np.array([0.4, 0.0, 0.0, 0.0])
    before = derivative(f16(), x, u)
    u[stick] = (flown.surfaces - start.surfaces)[0, stick - 1]
    assert abs(flown.x[0, rate]) > 0.003
    assert np.sign(flown.x[0, rate]) == np.sign((derivative(f16(), x, u) - before)[rate])
    assert np.sign(flown.x[0, rate]) == {S.Q: 1, S.P: 1, S.R: -1}[rate]


def test_a_throttle_gives_the_thrust_of_the_published_aircraft():
    thrust, throttle = jsbsim_f16.throttles(START.speed, START.height)
    wanted = trim(f16(), START.speed, START.height, START.climb_rate)
    ours = steady_thrust(wanted.u[0], START.speed, START.height)
    (aircraft,) = jsbsim_f16.begin(START, 1).live[0]
    assert np.interp(ours, thrust, throttle) == pytest.approx(aircraft["fcs/throttle-cmd-norm"], abs=0.02)


def test_same_sticks_same_bits_also_when_the_past_is_flown_again():
    sticks = some_sticks(120)
    middle = fly(jsbsim_f16.begin(START, 2), sticks[:60])
    end = fly(middle, sticks[60:])
    assert not middle.live, "the objects have flown on"
    again = fly(middle, sticks[60:])
    other = fly(middle, some_sticks(60, seed=2))
    np.testing.assert_array_equal(end.x, again.x)
    np.testing.assert_array_equal(end.surfaces, again.surfaces)
    assert (end.x != other.x).any()
    np.testing.assert_array_equal(fly(jsbsim_f16.begin(START, 1), sticks[:, 1:]).x[0], end.x[1])


def test_what_reaches_the_ground_stays_there():
    low = Start(START.speed, 40.0, 0.0, 0.0, 0.02)
    end = fly(jsbsim_f16.begin(low, 2), [np.array([[0.1, 0.44, 0.0, 0.0], [0.9, -0.2, 0.0, 0.0]])] * 200)
    further = fly(end, [np.zeros((2, 4))] * 5)
    assert end.x[0, S.UP] <= 0.0 < end.x[1, S.UP]
    np.testing.assert_array_equal(end.x[0], further.x[0])
    assert np.isfinite(further.x).all()


def test_the_mission_is_flown_under_jsbsims_own_control_laws():
    sim = Simulation(scenario(duration=15.0, parameters=JSBSIM, driving_test="none")).advance()
    mission = sim._assembly.navigator._law.mission
    wanted = np.array([mission.at(k)[0] for k in range(1, 751)])
    assert np.abs(sim["height.healthy"][:, 0] - wanted[:, 8]).max() < 6.0
    assert np.abs(np.rad2deg(sim["truth.roll"][:, 0] - wanted[:, 3])).max() < 6.0
    assert np.abs(sim["truth.speed"][:, 0] - 153.0).max() < 3.0


def test_given_a_rewind_a_fork_or_a_batch_then_the_flight_is_the_same():
    alone = Simulation(scenario(pair(1), 1.6, parameters=JSBSIM)).advance()
    sim = Simulation(scenario(pair(1), 1.6, parameters=JSBSIM)).advance(until=1.3)
    fork = sim.fork(at=0.98)
    for flight in (fork.advance(), sim.rewind(to=1.02).advance()):
        assert np.array_equal(flight.recording.rows, alone.recording.rows, equal_nan=True)
    batch = Simulation(scenario(pair(1), 1.6, parameters=JSBSIM), runs=3).advance()
    third = Simulation(scenario(pair(1), 1.6, parameters=JSBSIM), first_run=2).advance()
    np.testing.assert_allclose(
        batch.recording.rows[:, 2], third.recording.rows[:, 0], rtol=1e-7, atol=1e-7, equal_nan=True
    )


@pytest.mark.parametrize(
    ("wrong", "place", "message"),
    [
        ({"mismatch": {"mass": 5.0}}, ("parameters", "mismatch"), "leave mismatch out"),
        ({"flight": {"legs": [{"bank": 30.0}]}}, ("parameters", "flight", "legs", 0, "bank"), "wings level"),
    ],
)
def test_what_jsbsim_cannot_begin_with_is_refused_at_its_field(wrong, place, message):
    with pytest.raises(ValidationError, match=message) as refused:
        scenario(parameters=JSBSIM | wrong)
    assert refused.value.errors()[0]["loc"] == place


def test_a_flight_too_long_to_be_kept_is_refused():
    with pytest.raises(CommandError, match="at most 1000 s") as refused:
        Simulation(scenario(duration=2000.0, parameters=JSBSIM))
    assert refused.value.field == "duration"


def test_given_gyros_that_read_nonsense_then_nothing_is_ever_infinite():
    """The aircraft without FDI departs, and reaches the ground."""
    low = {"flight": {"height": 300.0}}
    faults = [bias("1x", 20.0, 0.5), bias("2y", -20.0, 2.0)]
    sim = Simulation(scenario(faults, 12.0, parameters=JSBSIM | low), runs=2).advance()
    for name, column in sim.recording.column.items():
        if not name.startswith("residual.ukf.") and not name.endswith(".statistic"):
            assert np.isfinite(sim.recording.rows[..., column]).all(), name
    assert (sim["unprotected.distance"][-1] > 100.0).all()


def test_without_the_package_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    jsbsim_f16.throttles.cache_clear()
    assert catalogue.indicators("redundant-imu", JSBSIM)
    with pytest.raises(CommandError, match=r"install ftlab\[jsbsim\]") as refused:
        Simulation(Scenario.load("kim-2005-jsbsim"))
    assert refused.value.field == "parameters.plant"
