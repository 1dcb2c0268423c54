"""System C with an inertial unit gone wild: whatever the schema allows, every number stays a number."""

import numpy as np
import pytest

from ftcore import Fault, Scenario, Simulation
from ftcore.estimation import kalman

UNTESTED = {"driving_test": "none"}
FEDERATED = {"master": "federated", "fusion_mode": "no-reset"}


def numbers(settings, channel, magnitude, unit, until=40.0):
    """Flown with a bias from 10 s on: names of signals of the estimators that are not finite."""
    configuration = "redundant" if channel[-1].isdigit() or channel[-2].isdigit() else "three-axis"
    document = {
        "system": "sins-gps-bd2-cns",
        "duration": until,
        "seed": 3,
        "settings": settings,
        "parameters": {"inertial": {"configuration": configuration}},
        "faults": [Fault(channel=channel, kind="bias", magnitude=magnitude, unit=unit, start=10.0)],
    }
    sim = Simulation(Scenario.model_validate(document)).advance()
    said = [n for n in sim.signals if {"error", "sigma", "nees", "weight", "probability"} & set(n.split("."))]
    return [n for n in said if not np.isfinite(sim[n]).all()]


WILD = [
    (UNTESTED, "imu.gyro.y", 3.0, "rad/s"),
    (UNTESTED | FEDERATED, "imu.gyro.z", 3.0, "rad/s"),
    (UNTESTED | {"imu_driving_test": "none"}, "imu.gyro.2y", 12.0, "rad/s"),
    ({}, "imu.gyro.all", 20.0, "rad/s"),
]


@pytest.mark.parametrize(("settings", "channel", "magnitude", "unit"), WILD)
def test_given_a_gyro_gone_wild_then_the_flight_goes_on_in_numbers(settings, channel, magnitude, unit):
    assert numbers(settings, channel, magnitude, unit) == []


@pytest.mark.long
@pytest.mark.parametrize("magnitude", [0.5, 3.0, 12.0, 20.0])
@pytest.mark.parametrize("channel", ["x", "y", "z", "all", "1x", "2y", "3x"])
@pytest.mark.parametrize(
    "settings", [{}, UNTESTED, UNTESTED | FEDERATED, {"driving_test": "two-propagator-state"}], ids=str
)
def test_given_any_gyro_and_any_size_then_the_flight_goes_on_in_numbers(settings, channel, magnitude):
    if channel[0].isdigit():
        settings = settings | {"imu_driving_test": "none"}
    assert numbers(settings, f"imu.gyro.{channel}", magnitude, "rad/s", until=100.0) == []


def test_given_a_sound_covariance_then_it_is_not_touched():
    P = np.diag([1e14, 1.0, 1e-20]) + 0.0
    assert kalman.sound(P) is P


def test_given_a_covariance_that_rounding_has_made_indefinite_then_it_is_mended_and_its_neighbour_is_not():
    good, bad = np.diag([4.0, 1.0]), np.array([[4.0, 2.0], [2.0, 1.0 - 1e-12]])
    mended = kalman.sound(np.stack([good, bad]))
    assert (mended[0] == good).all()
    assert (np.linalg.eigvalsh(mended[1]) > 0.0).all()
    np.testing.assert_allclose(mended[1], bad, rtol=1e-7)
    assert (mended[1] == mended[1].T).all()
