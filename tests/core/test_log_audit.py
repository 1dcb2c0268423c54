"""A log that does not keep to what is assumed of it is told so before it flies, and how it would fit."""

import dataclasses

import numpy as np
import pytest

from ftcore import Scenario, Simulation
from ftcore.sensors import rinex
from ftcore.systems.gps_receiver.audit import P_FALSE, audit
from ftcore.systems.gps_receiver.forms import Log, Parameters
from ftcore.systems.gps_receiver.logs import log_scenario
from tests.synthetic_log import ANTENNA, files

EPOCHS = 60


@pytest.fixture(scope="module")
def silent():
    """A log without noise."""
    made = files(EPOCHS, 1.0, noise=0.0)
    return rinex.parse(made.observation, made.navigation)


def noisy(log, sigma, seed):
    """The log with white noise."""
    rng = np.random.default_rng(seed)
    return dataclasses.replace(log, pseudorange=log.pseudorange + sigma * rng.standard_normal(log.pseudorange.shape))


def said(log, floor=1.0, antenna=ANTENNA, slant=0.0):
    """Remarks by kind; with a noise that is the floor alone, unless a slant is assumed too."""
    form = Log(observation="o", navigation="n", floor=floor, slant=slant)
    return {remark.kind: remark for remark in audit(log, Parameters(log=form), tuple(np.asarray(antenna).tolist()))}


def moved(path, noise=1.0, interval=1.0):
    made = files(EPOCHS, interval, noise=noise, path=path)
    return rinex.parse(made.observation, made.navigation)


# ---- noise


@pytest.mark.parametrize("sigma", [0.3, 1.0, 1.1])
def test_given_the_noise_that_is_assumed_or_less_then_nothing_is_said(silent, sigma):
    """12 logs of 3 windows, by P_FALSE a window and test: at most 1.2 % of such tests would fail by chance at 1 m."""
    assert not any(said(noisy(silent, sigma, seed), max(sigma, 1.0)) for seed in range(12))


@pytest.mark.parametrize("sigma", [3.0, 5.0, 15.0, 60.0])
def test_given_larger_noise_then_it_is_said_with_the_floor_that_fits(silent, sigma):
    floors = []
    for seed in range(12):
        remarks = said(noisy(silent, sigma, seed))
        assert set(remarks) == {"log.noise"}  # and is not taken for movement
        noise = remarks["log.noise"]
        assert f"{P_FALSE:g}" in noise.text
        assert f"a floor of {noise.numbers['fitting_floor']:g} m would fit" in noise.text
        floors.append(noise.numbers["fitting_floor"])
    # The median of 12 estimates on 3 windows of 80 degrees of freedom each is good to 3 %; two digits are told.
    assert np.median(floors) == pytest.approx(sigma, rel=0.1)
    assert not said(noisy(silent, sigma, 0), floor=float(np.median(floors)))


def test_given_one_wrong_satellite_then_it_is_not_taken_for_noise(silent):
    log = noisy(silent, 1.0, 5)
    ranges = log.pseudorange.copy()
    ranges[:, np.flatnonzero(np.isfinite(ranges[0]))[2]] += 40.0
    assert not said(dataclasses.replace(log, pseudorange=ranges))


# ---- movement


@pytest.mark.parametrize(
    ("path", "noise", "interval"),
    [
        (lambda t: (t, 0.0, 0.0), 1.0, 1.0),  # a walk
        (lambda t: (6.0 * np.sin(t / 3.0), 6.0 * np.cos(t / 3.0), 0.0), 1.0, 1.0),  # round and round
        (lambda t: (0.1 * t, 0.0, 0.0), 1.0, 30.0),
        (lambda t: (20.0 * t, 5.0 * t, 0.0), 4.0, 1.0),  # a car with a phone
        (lambda t: (250.0 * t, 0.0, 3.0 * t), 1.0, 10.0),  # an airliner: 150 km
        (lambda t: (60.0 * (t > 29.0), 0.0, 0.0), 1.0, 1.0),  # carried over the street once
    ],
)
def test_given_a_receiver_that_moves_then_it_is_said(path, noise, interval):
    remarks = said(moved(path, noise, interval))
    assert "does not stand still" in remarks["log.moving"].text
    assert "log.antenna" not in remarks
    assert ("log.noise" in remarks) == (noise > 1.0)


def test_given_a_receiver_that_stands_then_no_movement_is_said_whatever_the_noise(silent):
    for sigma in (1.0, 2.0, 10.0):
        assert not any("log.moving" in said(noisy(silent, sigma, seed)) for seed in range(20, 28))


# ---- the antenna


@pytest.mark.parametrize("away", [(20.0, 0.0, 0.0), (0.0, -30.0, 0.0), (1e3, 0.0, 0.0), (-1e6, 2e5, 3e5)])
def test_given_a_wrong_antenna_position_then_it_is_said_how_far_off_it_is(silent, away):
    remark = said(noisy(silent, 1.0, 3), antenna=ANTENNA + away)["log.antenna"]
    assert remark.numbers["distance"] == pytest.approx(np.linalg.norm(away), abs=3.0)


def test_given_an_antenna_within_the_errors_then_nothing_is_said(silent):
    assert not said(noisy(silent, 1.0, 3), antenna=ANTENNA + np.array([1.5, 1.0, -1.0]))


# ---- in flight


def test_given_a_flight_then_remarks_are_events_at_its_start_that_outlive_a_rewind(tmp_path):
    made = files(EPOCHS, 1.0, noise=8.0)
    (tmp_path / "o").write_bytes(made.observation)
    (tmp_path / "n").write_bytes(made.navigation)
    paths = str(tmp_path / "o"), str(tmp_path / "n")
    sim = Simulation(Scenario.model_validate(log_scenario(*paths)))
    kinds = [event.kind for event in sim.events]
    assert kinds == ["log.reading", "log.noise"]
    assert all(event.time == 0.0 and event.run == -1 and event.detail["text"] for event in sim.events)
    sim.advance(epochs=3)
    sim.rewind(to=0.0)
    assert [event.kind for event in sim.events] == kinds
    fits = sim.events[1].detail["fitting_floor"]
    again = Simulation(Scenario.model_validate(log_scenario(*paths, noise_floor=fits)))
    assert [event.kind for event in again.events] == ["log.reading"]
    with pytest.raises(rinex.LogError, match=r"0\.01 to 100 m") as refused:
        log_scenario(*paths, noise_floor=1e3)
    assert refused.value.part == "floor"
