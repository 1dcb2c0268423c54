"""The redundant IMU under a SINS: a second fault, an instrument that comes back, too few that read."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from ftcore import Fault, Scenario, Simulation

RUNS = 4
P_BAND = 1e-6
"""How often a consistent flight leaves the band of NEES."""


def fly(faults, seconds, **settings):
    ready = Scenario.load("zhang-1992-visible")
    changes = {"faults": tuple(faults), "duration": seconds, "settings": ready.settings | settings}
    return Simulation(ready.model_copy(update=changes), runs=RUNS, seed=77).advance()


def bias(axis, magnitude, start, end):
    return Fault(channel=f"imu.accelerometer.{axis}", kind="bias", magnitude=magnitude, unit="mg", start=start, end=end)


def times(sim, kind, subject):
    return [[e.time for e in sim.events if (e.run, e.kind, e.subject) == (run, kind, subject)] for run in range(RUNS)]


@pytest.mark.parametrize("driver", ["glt", "parity"])
def test_given_the_first_culprit_recovers_under_a_second_fault_then_it_comes_back_and_the_second_goes(driver):
    """Accelerometer 1 from 20 to 40 s, accelerometer 2 from 35 to 70 s: 20 data-sheet sigmas each."""
    sim = fly([bias("1x", 2.0, 20.0, 40.0), bias("2y", 2.0, 35.0, 70.0)], 80.0, imu_driving_test=driver)
    stem = "imu.accelerometer"
    for run in range(RUNS):
        assert times(sim, "subsystem.isolated", f"{stem}.1")[run] == [pytest.approx(21.5, abs=1.0)]
        assert times(sim, "integrity.cannot-isolate", stem)[run] == [pytest.approx(36.5, abs=1.0)]
        assert times(sim, "subsystem.readmitted", f"{stem}.1")[run] == [pytest.approx(45.0, abs=1.0)]
        assert times(sim, "subsystem.isolated", f"{stem}.2")[run] == [pytest.approx(47.0, abs=1.5)]
        assert times(sim, "integrity.restored", stem)[run] == [pytest.approx(50.0, abs=2.0)]
        assert times(sim, "subsystem.readmitted", f"{stem}.2")[run] == [pytest.approx(75.0, abs=1.0)]
        assert not times(sim, "subsystem.isolated", f"{stem}.3")[run]
    assert all(sim[f"used.{stem}.{k}"][-1].all() for k in (1, 2, 3))


@pytest.mark.parametrize("cluster", ["gyro", "accelerometer"])
@pytest.mark.parametrize("left", [1, 0])
def test_given_readings_of_fewer_than_two_instruments_then_what_is_unseen_is_held_and_the_estimate_says_how_good_it_is(
    cluster, left
):
    faults = [Fault(channel=f"imu.{cluster}.{k}x", kind="dropout", start=30.0, end=40.0) for k in range(1, 4 - left)]
    sim = fly(faults, 60.0)
    band = chi2.isf(P_BAND / 2.0, 9 * RUNS) / RUNS, chi2.ppf(P_BAND / 2.0, 9 * RUNS) / RUNS
    for second in (29, 35, 39, 45, 60):
        assert band[1] < sim["fused.nees"][second - 1].mean() < band[0], second
    assert np.abs(sim["fused.error.position.horizontal"][30:40]).max() < 10.0
    assert not [e for e in sim.events if e.kind == "subsystem.isolated"]
    assert all(sim[f"used.imu.{cluster}.{k}"][-1].all() for k in (1, 2, 3))
