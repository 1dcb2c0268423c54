"""Do the filters know how wrong they are? NEES of nine navigation states over 100 runs."""

from __future__ import annotations

import numpy as np
import pytest

from tests.papers.bands import mean_band
from tests.papers.flights import CALM, RUNS, flown

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


@pytest.mark.parametrize("scenario", ["zhang-1992-visible", "zhang-1992"])
def test_given_both_failures_then_the_fused_estimate_still_knows_how_wrong_it_is(scenario):
    """False failure 1e-4, and what a withheld measurement more or less does to it."""
    low, high = mean_band(STATES, RUNS, OUTSIDE)
    found = mean_nees(scenario, "fused")
    assert low <= found.min() <= found.max() <= high, found


def test_given_a_failure_then_who_believes_it_does_not_know_how_wrong_it_is():
    assert mean_nees("zhang-1992-visible", "gps")[-1] > 10.0


def test_given_inflated_local_filters_then_the_fused_estimate_is_conservative_but_not_absurdly():
    """The bound (27): P is at least the true covariance, so NEES / dof is at most one, in the mean over 100 runs with
    its band. It is hardly less: what is inflated is P(0) and Q, and the fused estimate lives of measurements."""
    _, high = mean_band(STATES, RUNS, OUTSIDE)
    found = mean_nees(CALM, "fused", fusion_mode="no-reset")
    assert 0.5 <= found.min() <= found.max() <= high, found


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
