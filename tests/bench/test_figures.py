"""The ratios that FTLab must reach, asserted as they stand, and the times, asserted at the reference machine's pace.

Processor seconds, one BLAS thread. A busy neighbour can only make a try slower, so each cost is the least of several
tries, taken turn by turn with what it is compared with: the other, or the yardstick that tells the machine's pace. No
bound is loosened: what is not reached fails, or is skipped with its figure where others keep the machine busy.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from ftcore import Scenario, Simulation, catalogue
from tests.bench import covariance, flights, integrated
from tests.bench.measure import best, reached, seconds

pytestmark = pytest.mark.alone
ROUNDS = 2
SYSTEMS = [s.id for s in catalogue.systems()]


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    with threadpool_limits(1):
        yield


@cache
def cost(system: str) -> tuple[float, float]:
    """Of one run and of a batch."""
    return flights.cost(flights.default_scenario(system), ROUNDS)


@pytest.mark.parametrize("system", SYSTEMS)
def test_given_a_system_then_one_run_is_as_fast_as_wanted_with_everything_on(system: str) -> None:
    """If the first tries met a busy neighbour, more: the least of them still errs on the slow side."""
    scenario = flights.default_scenario(system)
    time = flights.flown(scenario)
    one = flights.alone(scenario, time / flights.real_time_factor_wanted(system), tries=8 * ROUNDS)
    factor = time / one.at_reference
    said = f"{system}: real-time factor {time / one.seconds:.0f}, {factor:.0f} at the reference pace ({one})"
    reached(factor >= flights.real_time_factor_wanted(system), said)


@pytest.mark.parametrize("system", SYSTEMS)
def test_given_a_system_then_100_runs_cost_10_single_ones_at_most(system: str) -> None:
    one, many = cost(system)
    for _ in range(2):
        if many > flights.COST_OF_A_BATCH * one:
            again = flights.cost(flights.default_scenario(system), ROUNDS)
            one, many = min(one, again[0]), min(many, again[1])
    reached(many <= flights.COST_OF_A_BATCH * one, f"{system}: {flights.BATCH} runs cost {many / one:.1f} single ones")


def test_given_the_flight_of_kim_2005_then_15_s_with_both_twins_take_3_s_and_20_runs_cost_5_at_most() -> None:
    """Three aircraft, FDI and UKF; the fault comes at 1 s, so the UKF runs nearly all the time.

    Tried until it is met.
    """
    scenario = Scenario.load("kim-2005")
    Simulation(scenario).advance(epochs=3)
    alone = best(lambda: flights.by_epochs(scenario), 3.0, 8 * ROUNDS)
    one = many = np.inf
    for _ in range(4 * ROUNDS):
        one = min(one, *(seconds(lambda: Simulation(scenario).advance()) for _ in range(2)))
        many = min(many, seconds(lambda: Simulation(scenario, runs=20).advance()))
        if many <= 5.0 * one:
            break
    said = f"{scenario.duration:g} s in {alone}; 20 runs cost {many / one:.1f} single ones"
    reached(alone.at_reference <= 3.0 and many <= 5.0 * one, said)


def test_given_the_same_matrices_then_our_cycle_gives_what_filterpy_gives() -> None:
    """Each in units of its sigma. filterpy inverts S and multiplies out the Joseph form; that is what 1e-6 is for."""
    cycle = covariance.real_cycle()
    filters = cycle.filterpy()
    cycle.theirs(filters)
    ours = cycle.ours()
    sigma = np.sqrt(np.diagonal(ours.P, axis1=-2, axis2=-1))
    for k, theirs in enumerate(filters):
        np.testing.assert_allclose(ours.x[k] / sigma[k], theirs.x / sigma[k], rtol=0.0, atol=1e-6)
        unit = np.outer(sigma[k], sigma[k])
        np.testing.assert_allclose(ours.P[k] / unit, theirs.P / unit, rtol=0.0, atol=1e-6)


def test_given_100_runs_then_the_covariance_cycle_has_five_times_the_throughput_of_filterpy() -> None:
    """If the tries met a busy neighbour, as many again: the least of all, of filterpy's too, so neither is favoured."""
    cycle = covariance.real_cycle()
    ours, theirs = covariance.compare(cycle, tries=25)
    for _ in range(3):
        if theirs / ours < covariance.AGAINST_FILTERPY:
            again = covariance.compare(cycle, tries=25)
            ours, theirs = min(ours, again[0]), min(theirs, again[1])
    said = f"{theirs / ours:.2f} times filterpy: {1e4 * ours:.1f} and {1e4 * theirs:.1f} us a run"
    reached(theirs / ours >= covariance.AGAINST_FILTERPY, said)


def test_given_the_same_imu_data_then_all_of_it_flies_five_times_faster_than_the_15_state_filter_of_pyins() -> None:
    here, there, apart = integrated.compare(tries=3)
    for _ in range(2):
        if there / here < integrated.AGAINST_PYINS:
            again = integrated.compare(tries=3)
            here, there = min(here, again[0]), min(there, again[1])
    assert apart < 5.0, "both know where they are: GPS is good to 3 m"
    said = f"{there / here:.2f} times pyins; {1e3 * here / integrated.SECONDS:.2f} ms a second of flight"
    reached(there / here >= integrated.AGAINST_PYINS, said)


def test_given_50_runs_of_the_imm_system_then_they_cost_8_single_ones_at_most() -> None:
    one, many = integrated.batch(tries=2)
    reached(many <= integrated.COST_OF_A_BATCH * one, f"{integrated.BATCH} runs cost {many / one:.1f} single ones")


@pytest.mark.long
def test_given_an_hour_with_everything_on_then_it_takes_18_s_of_one_core() -> None:
    hour = best(lambda: flights.by_epochs(integrated.scenario(3600.0)), integrated.HOUR, 4)
    reached(hour.at_reference <= integrated.HOUR, f"one hour: {hour}")
