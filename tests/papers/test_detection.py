"""How often the residual test sees a fault of a given size in its first epoch, against the noncentral chi-square."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import ncx2

from ftcore import Fault, Simulation
from tests.papers.bands import sum_band
from tests.papers.flights import CALM, RUNS, prepared

SIZES = (35.0, 50.0, 65.0)
"""Metres on one pseudorange: hardly seen, seen half the time, nearly always seen."""
CHANNEL = "gps.pseudorange.C1"
OUTSIDE = 1e-4


def first_epoch(runs: int, seed: int, times: range) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """Size -> alarms and what theory expects of each, for faults that begin at each of `times` on branches of a flight.

    The noncentrality is b' S^-1 b of the filter's own S, and it is measured, not modelled: with the same noise, half of
    lambda(+b) + lambda(-b) exceeds lambda(0) by exactly that, and it grows with the square of b.
    """
    calm = Simulation(prepared(CALM), runs=runs, seed=seed)
    alarms: dict[float, list[np.ndarray]] = {size: [] for size in SIZES}
    theory: dict[float, list[np.ndarray]] = {size: [] for size in SIZES}

    def broken(size: float, name: str) -> np.ndarray:
        branch = calm.fork()
        branch.inject(Fault(channel=CHANNEL, kind="bias", magnitude=size, start=branch.now + 1.0))
        return branch.step()[f"test.residual.gps.{name}"][-1]

    for time in times:
        calm.advance(until=time - 1.0)
        unit = 0.5 * (broken(SIZES[0], "statistic") + broken(-SIZES[0], "statistic"))
        seen = {size: broken(size, "alarm") for size in SIZES}
        calm.step()
        none, dof, limit = (calm[f"test.residual.gps.{name}"][-1] for name in ("statistic", "dof", "threshold"))
        unit = (unit - none) / SIZES[0] ** 2
        for size in SIZES:
            alarms[size].append(seen[size] > 0.0)
            theory[size].append(ncx2.sf(limit, dof, unit * size**2))
    return {size: (np.concatenate(alarms[size]), np.concatenate(theory[size])) for size in SIZES}


def assert_as_theory_says(size: float, alarms: np.ndarray, theory: np.ndarray) -> None:
    """The count of detections lies in the band of a sum of independent events; innovations are white."""
    low, high = sum_band(theory, OUTSIDE)
    print(f"{size:g} m: seen {alarms.mean():.3f} of {alarms.size}, theory {theory.mean():.3f}")
    assert low <= alarms.sum() <= high


@pytest.fixture(scope="module")
def few() -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """200 first epochs."""
    return first_epoch(40, 35, range(20, 70, 10))


@pytest.fixture(scope="module")
def many() -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """6000 first epochs."""
    return first_epoch(4 * RUNS, 36, range(20, 95, 5))


@pytest.mark.parametrize("size", SIZES)
def test_given_a_pseudorange_bias_then_it_is_detected_as_often_as_theory_says(size, few):
    """False failure 1e-4 for each size."""
    assert_as_theory_says(size, *few[size])


def test_given_three_sizes_then_they_span_the_range_from_hardly_to_nearly_always(few):
    expected = [few[size][1].mean() for size in SIZES]
    assert expected[0] < 0.25
    assert 0.35 < expected[1] < 0.65
    assert expected[2] > 0.8


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("size", SIZES)
def test_given_6000_first_epochs_then_the_rate_of_detection_is_known_to_two_percent(size, many):
    """False failure 1e-4 for each size."""
    assert_as_theory_says(size, *many[size])
