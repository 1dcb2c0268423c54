"""Do the filters know how wrong they are? NEES of nine navigation states over 100 runs."""

from __future__ import annotations

import numpy as np
import pytest

from ftcore import Fault, Simulation
from tests.papers.bands import mean_band
from tests.papers.flights import CALM, RUNS, between, flown, prepared, runs_with

STATES = 9
EPOCHS = (1, 5, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100)
OUTSIDE = 1e-5
ESTIMATORS = ("fused", "gps", "doppler", "unprotected")


def mean_nees(scenario: str, estimator: str, **settings: str) -> np.ndarray:
    """NEES by degrees of freedom, mean over runs, at :data:`EPOCHS`."""
    nees = flown(scenario, **settings)[f"{estimator}.nees"]
    return nees[np.array(EPOCHS) - 1].mean(axis=1) / STATES


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_given_nothing_fails_then_every_filter_that_is_not_inflated_is_consistent(estimator):
    """Fusion-reset, the default, is the centralised filter. 12 epochs with 1e-5 each: false failure 1e-4 for each."""
    assert flown(CALM).settings["fusion_mode"] == "fusion-reset"
    low, high = mean_band(STATES, RUNS, OUTSIDE)
    found = mean_nees(CALM, estimator)
    assert low <= found.min() <= found.max() <= high, found


@pytest.mark.long
@pytest.mark.parametrize("scenario", ["zhang-1992-visible", "zhang-1992"])
def test_given_both_failures_then_the_fused_estimate_still_knows_how_wrong_it_is(scenario):
    """False failure 1e-4, and what a withheld measurement more or less does to it."""
    low, high = mean_band(STATES, RUNS, OUTSIDE)
    found = mean_nees(scenario, "fused")
    assert low <= found.min() <= found.max() <= high, found


@pytest.mark.long
def test_given_a_failure_then_who_believes_it_does_not_know_how_wrong_it_is():
    assert mean_nees("zhang-1992-visible", "gps")[-1] > 10.0


@pytest.mark.long
def test_given_inflated_local_filters_then_the_fused_estimate_is_conservative_but_not_absurdly():
    """The bound (27): P is at least the true covariance, so NEES / dof is at most one, in the mean over 100 runs with
    its band. It is hardly less: what is inflated is P(0) and Q, and the fused estimate lives of measurements."""
    _, high = mean_band(STATES, RUNS, OUTSIDE)
    found = mean_nees(CALM, "fused", fusion_mode="no-reset")
    assert 0.5 <= found.min() <= found.max() <= high, found


@pytest.mark.long
@pytest.mark.parametrize("part", ["position.up", "velocity.east", "attitude.up"])
def test_given_inflated_local_filters_then_sigma_is_never_below_that_of_the_optimal_filter(part):
    """On the same noise; the median of the runs, which no false alarm touched. Exact, not statistical."""
    inflated, optimal = (flown(CALM, **mode)[f"fused.sigma.{part}"] for mode in ({"fusion_mode": "no-reset"}, {}))
    ratio = np.median(inflated / optimal, axis=1)
    assert np.all(ratio >= 1.0 - 1e-9)
    assert ratio.max() < 1.5


@pytest.mark.long
@pytest.mark.parametrize("mode", ["zero-reset", "rescale"])
def test_given_another_mode_then_the_fused_estimate_is_consistent_or_cautious(mode):
    """zero-reset is the centralised filter again, rescale a bound close to it. False failure 1e-4."""
    low, high = mean_band(STATES, RUNS, OUTSIDE)
    found = mean_nees(CALM, "fused", fusion_mode=mode)
    assert (low if mode == "zero-reset" else 0.5) <= found.min() <= found.max() <= high, found


@pytest.mark.long
def test_given_covariance_intersection_then_the_fused_estimate_is_cautious():
    _, high = mean_band(STATES, RUNS, OUTSIDE)
    found = mean_nees(CALM, "fused", fusion_mode="no-reset", master="covariance-intersection")
    assert 0.3 <= found.min() <= found.max() <= high, found


# ---- what is common is shared out, what is withheld stays withheld


@pytest.mark.parametrize("mode", ["fusion-reset", "zero-reset"])
def test_given_gps_is_the_only_aid_when_an_instrument_is_put_out_then_the_fused_filter_is_the_gps_filter(mode):
    """Both are the optimal filter of the same measurements, so they agree to rounding. 1 mg at 30 s, out at 32 s."""
    scenario = prepared("zhang-1992-visible", fusion_mode=mode)
    accelerometer = tuple(fault for fault in scenario.faults if fault.id == "accelerometer")
    scenario = scenario.model_copy(update={"faults": accelerometer, "subsystems": {"doppler": False}})
    sim = Simulation(scenario, runs=10).advance(until=60.0)
    assert runs_with(sim, "subsystem.isolated", "imu.accelerometer.3") == set(range(10))
    for part in ("position.up", "velocity.up", "velocity.east", "attitude.north"):
        ratio = np.median(sim[f"fused.sigma.{part}"] / sim[f"gps.sigma.{part}"], axis=1)
        np.testing.assert_allclose(ratio, 1.0, rtol=1e-6, err_msg=part)


@pytest.mark.long
@pytest.mark.parametrize(
    "mode",
    [
        "fusion-reset",
        "zero-reset",
        "no-reset",
        "rescale",
    ],
)
def test_given_a_single_outlier_then_what_was_withheld_from_the_master_never_reaches_it(mode):
    """500 m in one pseudorange in one epoch, against the same noise without it, from the epoch after it on: only the
    information of an epoch may be missing, a fraction of sigma (2.6 m). Median of 20 runs."""
    calm = prepared(CALM, fusion_mode=mode)
    outlier = Fault(id="outlier", channel="gps.pseudorange.C1", kind="bias", magnitude=500.0, start=50.0, end=51.0)
    without, hit = (
        Simulation(scenario, runs=20).advance(until=60.0)
        for scenario in (calm, calm.model_copy(update={"faults": (outlier,)}))
    )
    assert len(runs_with(hit, "subsystem.suspected", "gps", 50.0, 50.0)) == 20
    moved = [
        between(hit, f"fused.error.position.{part}", 50.0, 60.0)
        - between(without, f"fused.error.position.{part}", 50.0, 60.0)
        for part in ("east", "north", "up")
    ]
    assert np.median(np.linalg.norm(moved, axis=0), axis=1).max() < 1.0
