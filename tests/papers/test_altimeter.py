"""System A: a fault of the altimeter is named, harms nobody else, and leaves nothing behind. Over many runs.

What Zhang 1992 has not: its altimeter is believed whatever it reads. `zhang-1992-visible` with and without its faults.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import binom, norm

from ftcore import Fault, Scenario, Simulation
from tests.papers.bands import mean_band
from tests.papers.flights import RUNS, between, runs_with

STARTS, ENDS, SEED = 50.0, 80.0, 9961
CHANNEL = "altimeter.height.up"
FAULTS = {
    "100 m": Fault(channel=CHANNEL, kind="bias", magnitude=100.0, start=STARTS, end=ENDS),
    "30 m": Fault(channel=CHANNEL, kind="bias", magnitude=30.0, start=STARTS, end=ENDS),
    "1 m/s": Fault(channel=CHANNEL, kind="ramp", magnitude=1.0, start=STARTS, end=ENDS),
}
WITHIN = {"100 m": 3.0, "30 m": 3.0, "1 m/s": 10.0}
"""Seconds in which it is to be named: a ramp has to grow to four metres or so first."""


@lru_cache(maxsize=8)
def broken(fault: str, runs: int, own_faults: bool = False) -> Simulation:
    ready = Scenario.load("zhang-1992-visible")
    faults = (*(ready.faults if own_faults else ()), FAULTS[fault])
    return Simulation(ready.model_copy(update={"duration": 140.0, "faults": faults}), runs=runs, seed=SEED).advance()


def named_in_time(sim: Simulation, fault: str) -> int:
    return len(runs_with(sim, "subsystem.isolated", "altimeter", STARTS, STARTS + WITHIN[fault]))


def outside_3_sigma(sim: Simulation, time: float) -> int:
    k = np.searchsorted(sim.time, time - 1e-9)
    return int((np.abs(sim["fused.error.position.up"][k]) > 3.0 * sim["fused.sigma.position.up"][k]).sum())


def check(sim: Simulation, fault: str, own_faults: bool) -> None:
    """Named in 95 % of the runs, GPS and Doppler isolated in 2 % at most, and half a minute after the end the altitude
    within 3 sigma but for as many runs as chance has there (false failure 1e-4), NEES of the runs in its band (1e-5 an
    epoch, five epochs)."""
    runs = sim.runs
    assert named_in_time(sim, fault) >= 0.95 * runs
    wrong = runs_with(sim, "subsystem.isolated", "doppler", STARTS)
    if not own_faults:
        # GPS is a subject, its satellites are others: integrity is off here.
        wrong |= runs_with(sim, "subsystem.isolated", "gps", STARTS)
    assert len(wrong) <= 0.02 * runs, wrong
    assert not runs_with(sim, "subsystem.readmitted", "altimeter", STARTS, ENDS - 0.1)
    assert len(runs_with(sim, "subsystem.readmitted", "altimeter", ENDS, ENDS + 30.0)) >= 0.95 * runs
    assert outside_3_sigma(sim, ENDS + 30.0) <= binom.isf(1e-4, runs, 2.0 * norm.sf(3.0))
    low, high = mean_band(9, runs, 1e-5)
    for time in (49.0, 65.0, 79.0, 110.0, 140.0):
        nees = sim["fused.nees"][np.searchsorted(sim.time, time - 1e-9)].mean() / 9
        assert low < nees < high, f"NEES at {time:g} s is {nees:.2f} times its degrees of freedom"


def test_given_100_m_on_the_altimeter_then_it_is_named_nobody_else_and_nothing_is_left_behind():
    """Ten runs of the issue's own seed; in a hundred below."""
    check(broken("100 m", 10), "100 m", own_faults=False)


@pytest.mark.long
@pytest.mark.parametrize("own_faults", [False, True], ids=["altimeter only", "with accelerometer and satellite"])
@pytest.mark.parametrize("fault", FAULTS)
def test_given_any_of_three_faults_then_the_altimeter_is_named_and_nobody_else_and_nothing_is_left_behind(
    fault, own_faults
):
    """A hundred runs."""
    check(broken(fault, RUNS, own_faults), fault, own_faults)


def test_given_a_slow_fault_of_gps_then_the_altimeter_is_not_blamed_for_it():
    """0.5 m/s on one satellite: what the witness knows of height and bias moves together. Six runs."""
    ramp = Fault(channel="gps.pseudorange.C1", kind="ramp", magnitude=1.0, start=30.0)
    scenario = Scenario.load("zhang-1992").model_copy(update={"faults": (ramp,), "duration": 80.0})
    sim = Simulation(scenario, runs=6, seed=3).advance()
    assert np.abs(between(sim, "unprotected.error.position.up", 70.0, 80.0)).mean() > 3.0, "it could be noticed"
    assert not runs_with(sim, "subsystem.isolated", "altimeter")
