"""System A flown again without a culprit: the same as if the culprit had been switched off then."""

import numpy as np
import pytest

from ftcore import Fault, Scenario, Simulation
from ftcore.systems.sins_gps_doppler import hindsight
from ftcore.systems.sins_gps_doppler.bank import ALONE, CENTRAL, FUSED, SIZE, WITNESS
from ftcore.systems.sins_gps_doppler.history import SPACING, SPAN, Culprits

CALM = Scenario.load("zhang-1992").model_copy(update={"faults": (), "duration": 200.0})
RAMP = Fault(channel="gps.pseudorange.C1", kind="ramp", magnitude=2.0, start=25.0, end=60.0)


def state(sim):
    """What the navigator carries, its past and the numbers that flying again needs: the inside of the system."""
    navigator = sim._assembly.navigator
    return sim._state.navigator, (navigator._p.aiding, navigator._altimeter_variance, navigator._biases)


def culprits(runs, since, gps=False, altimeter=False, satellite=None):
    aids, satellites = np.zeros((runs, 2), bool), np.zeros((runs, 24), bool)
    aids[:, 0] = gps
    if satellite is not None:
        satellites[:, satellite] = True
    return Culprits(
        aids, np.zeros((runs, 2), bool), np.full(runs, altimeter), satellites, np.broadcast_to(since, (runs,))
    )


def scaled(P):
    sigma = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    return P / (sigma[..., :, None] * sigma[..., None, :])


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"fusion_mode": "no-reset", "master": "covariance-intersection"},
        {"fusion_mode": "rescale", "satellite_integrity": "innovation"},
        {"master": "tolerant"},
    ],
    ids=["default", "intersection", "rescale", "tolerant"],
)
def test_given_nobody_is_to_blame_then_what_is_flown_again_is_what_was_flown(settings):
    """With faults, isolations and re-admissions behind it; run 1 from another start than the others. The "culprit" is
    a satellite that is not in view."""
    scenario = CALM.model_copy(
        update={
            "settings": settings,
            "faults": (
                Fault(channel="altimeter.height.up", kind="bias", magnitude=50.0, start=10.0, end=15.0),
                Fault(channel="doppler.velocity.x", kind="bias", magnitude=3.0, start=25.0, end=30.0),
                Fault(channel="imu.gyro.2x", kind="bias", magnitude=200.0, unit="deg/h", start=27.0),
            ),
        }
    )
    sim = Simulation(scenario, runs=3, seed=4).advance(until=45.0)
    now, numbers = state(sim)
    hidden = next(i for i in range(24) if not any(e.trusted[:, i].any() for e in now.history.epochs))
    _, again = hindsight.fly_again(
        now.history, now.filters, culprits(3, np.array([3, 33, 3]), satellite=hidden), *numbers
    )
    np.testing.assert_allclose(again.x, now.filters.x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(scaled(again.P), scaled(now.filters.P), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("mode", ["fusion-reset", "no-reset", "zero-reset", "rescale"])
def test_given_gps_is_taken_out_afterwards_then_the_estimate_is_that_of_a_flight_that_switched_it_off_then(mode):
    scenario = CALM.model_copy(update={"settings": {"fusion_mode": mode}})
    sim = Simulation(scenario, runs=2, seed=6).advance(until=25.0)
    twin = sim.fork()
    sim.advance(until=45.0)
    twin.switch("gps", False).advance(until=45.0)
    now, numbers = state(sim)
    _, again = hindsight.fly_again(now.history, now.filters, culprits(2, 26, gps=True), *numbers)
    expected = state(twin)[0].filters
    for i in (0, 1, 2, FUSED, WITNESS):
        sigma = np.sqrt(np.diagonal(expected.P[:, i], axis1=-2, axis2=-1))
        np.testing.assert_allclose(again.x[:, i] / sigma, expected.x[:, i] / sigma, atol=1e-6)
        np.testing.assert_allclose(again.P[:, i], expected.P[:, i], rtol=1e-5, atol=1e-12)
    for i in (*ALONE, CENTRAL):
        assert np.allclose(again.x[:, i], now.filters.x[:, i]), "who believes it all the same goes on doing so"


def test_given_the_altimeter_is_taken_out_afterwards_then_the_height_is_that_of_a_flight_without_it():
    """The strapdowns differ, for one was damped with a wrong height; what both make of it agrees to centimetres.
    Nobody is isolated meanwhile: other decisions are kept when a flight is flown again."""
    settings = {"altimeter_driving_test": "none", "driving_test": "none"}
    sim = Simulation(CALM.model_copy(update={"settings": settings}), runs=2, seed=6).advance(until=25.0)
    twin = sim.fork()
    sim.inject(Fault(channel="altimeter.height.up", kind="bias", magnitude=80.0))
    sim.advance(until=45.0)
    twin.switch("altimeter", False).advance(until=45.0)
    (now, numbers), (other, _) = state(sim), state(twin)
    _, again = hindsight.fly_again(now.history, now.filters, culprits(2, 26, altimeter=True), *numbers)

    def height(navigator, filters):
        return navigator.ins.lla[::2, 2] - filters.x[:, FUSED, 2]

    moved = np.abs(now.ins.lla[::2, 2] - other.ins.lla[::2, 2])
    assert moved.min() > 20.0
    assert np.abs(height(now, now.filters) - height(other, other.filters)).min() > 1.0
    np.testing.assert_allclose(height(now, again), height(other, other.filters), atol=0.05)
    np.testing.assert_allclose(again.P[:, FUSED, 2, 2], other.filters.P[:, FUSED, 2, 2], rtol=1e-3)


def test_given_a_ramp_then_it_is_flown_again_from_before_it_was_noticed_and_the_event_says_since_when():
    """2 m/s from 25 s: half a minute later every run has named GPS, each in an epoch of its own."""
    sim = Simulation(CALM.model_copy(update={"faults": (RAMP,)}), runs=4, seed=11).advance(until=58.0)
    isolated = {e.run: e.time for e in sim.events if e.kind == "subsystem.isolated" and e.subject == "gps"}
    again = {e.run: e for e in sim.events if e.kind == "filter.reflown" and e.subject == "gps"}
    assert set(isolated) == set(again) == set(range(4))
    for run, event in again.items():
        assert 20.0 < event.detail["since [s]"] < event.time <= isolated[run]
        assert event.detail["epochs"] == event.time - event.detail["since [s]"] + 1.0
    assert len(set(isolated.values())) > 1


def test_given_runs_are_flown_again_from_different_epochs_then_each_is_what_it_is_alone():
    scenario = CALM.model_copy(update={"faults": (RAMP,), "settings": {"fusion_mode": "no-reset"}})
    batch = Simulation(scenario, runs=4, seed=11).advance(until=50.0)
    for run in (1, 3):
        alone = Simulation(scenario, runs=1, seed=11, first_run=run).advance(until=50.0)
        for part in ("error.position.up", "sigma.position.up", "error.velocity.east"):
            np.testing.assert_allclose(
                batch[f"fused.{part}"][:, run], alone[f"fused.{part}"][:, 0], rtol=1e-7, atol=1e-9
            )


def test_given_a_flight_that_was_flown_again_is_rewound_then_it_comes_to_the_same_bits():
    sim = Simulation(CALM.model_copy(update={"faults": (RAMP,)}), runs=2, seed=11).advance(until=50.0)
    before = sim["fused.error.position.up"].copy()
    sim.rewind(to=28.0)
    sim.advance(until=50.0)
    assert np.array_equal(before, sim["fused.error.position.up"])


def test_given_a_driving_test_that_is_blind_then_the_estimate_that_contradicts_gps_does_not_keep_what_it_took():
    """The state chi-square never sees 100 m on a satellite; nobody is isolated, yet half a minute after it has ended
    the estimate is right. Five sigma of two runs: false failure 4e-6."""
    fault = Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=100.0, start=40.0, end=60.0)
    scenario = CALM.model_copy(update={"faults": (fault,), "settings": {"driving_test": "state"}})
    sim = Simulation(scenario, runs=2, seed=5).advance(until=90.0)
    assert not [e for e in sim.events if e.kind == "subsystem.isolated" and e.subject == "gps"]
    assert {e.run for e in sim.events if e.kind == "filter.reflown" and e.subject == "gps"} == {0, 1}
    for part in ("east", "north", "up"):
        error, sigma = sim[f"fused.error.position.{part}"][-1], sim[f"fused.sigma.position.{part}"][-1]
        assert (np.abs(error) < 5.0 * sigma).all()
    assert sim["unprotected.nees"][-1].min() > 3.0 * sim["fused.nees"][-1].max(), "who believes everything is wrong"


def test_given_nothing_fails_then_nothing_is_flown_again():
    """600 run-epochs; a contradiction comes by chance in 1e-6 of them, a false isolation in 2e-6."""
    sim = Simulation(CALM, runs=10, seed=12).advance(until=60.0)
    assert not [e for e in sim.events if e.kind == "filter.reflown"]


def test_given_a_long_flight_then_what_is_remembered_is_bounded():
    sim = Simulation(CALM, seed=1).advance(until=100.0)
    past = state(sim)[0].history
    assert SPAN <= len(past.epochs) < SPAN + SPACING
    assert len(past.banks) <= SPAN // SPACING + 1
    assert past.banks[0][1].x.shape == (1, SIZE, 21)


def test_given_another_master_is_chosen_then_the_past_is_not_flown_again_with_it():
    sim = Simulation(CALM, seed=1).advance(until=30.0)
    sim.configure(fusion_mode="no-reset")
    sim.step()
    past = state(sim)[0].history
    assert len(past.epochs) == 1
    assert past.banks[0][0] == 30
