"""The claims of Chey, Jee and Lee (ICCAS 2004), Fig. 2: mean horizontal error of three methods over 100 runs.

Filter best without a fault; snapshot better in the fault, and the filter slow to recover; both combined never worse
than either by more than 10 %. All numbers are means over 100 runs on one seed; the phases hold 5 s at least, so that a
mean has a relative standard error of about 2 %.
"""

import numpy as np
import pytest

from ftcore import Scenario, Simulation

METHODS = ("snapshot", "filter", "combined")


def mean_errors(name):
    """Mean horizontal error over 100 runs, (epochs,) by method; epoch k is at index k - 1."""
    sim = Simulation(Scenario.load(name), runs=100).advance()
    return {m: sim[f"{m}.error.position.horizontal"].mean(axis=1) for m in (*METHODS, "unprotected")}, sim


@pytest.fixture(scope="module")
def drift():
    return mean_errors("chey-2004")


@pytest.fixture(scope="module")
def step():
    return mean_errors("chey-2004-step")


def over(errors, method, start, end):
    return float(errors[method][start:end].mean())


def test_given_no_fault_then_the_filter_is_best(drift):
    errors, _ = drift
    assert over(errors, "filter", 10, 29) < 0.7 * over(errors, "snapshot", 10, 29)
    assert over(errors, "filter", 90, 100) < 0.7 * over(errors, "snapshot", 90, 100)


def test_given_the_fault_once_it_can_be_seen_then_the_snapshot_is_better(drift):
    errors, _ = drift
    for start, end in ((60, 70), (70, 80)):
        assert over(errors, "snapshot", start, end) < 0.9 * over(errors, "filter", start, end)


def test_given_the_end_of_the_fault_then_the_snapshot_is_back_at_once_and_the_filter_is_slow(drift):
    errors, _ = drift
    calm = {m: over(errors, m, 10, 29) for m in METHODS}
    assert over(errors, "snapshot", 80, 85) < 1.1 * calm["snapshot"]
    assert over(errors, "filter", 80, 85) > 1.5 * calm["filter"]
    assert over(errors, "filter", 80, 85) > 1.1 * over(errors, "snapshot", 80, 85)
    assert over(errors, "filter", 90, 100) < 1.2 * calm["filter"]


@pytest.mark.parametrize("which", ["drift", "step"])
def test_combined_is_never_worse_than_either_by_more_than_ten_per_cent(which, request):
    """In every window of 5 s after the filters have settled."""
    errors, _ = request.getfixturevalue(which)
    windows = {m: np.convolve(errors[m][10:], np.full(5, 0.2), "valid") for m in METHODS}
    best = np.minimum(windows["snapshot"], windows["filter"])
    assert (windows["combined"] <= 1.1 * best).all()


def test_combined_is_better_than_both_while_the_fault_is_seen(drift):
    errors, _ = drift
    assert over(errors, "combined", 60, 80) < 0.7 * min(over(errors, m, 60, 80) for m in ("snapshot", "filter"))


def test_unprotected_shows_what_it_saves(drift, step):
    assert over(drift[0], "unprotected", 70, 80) > 4.0 * over(drift[0], "combined", 70, 80)
    assert over(step[0], "unprotected", 40, 80) > 6.0 * over(step[0], "combined", 40, 80)


def test_given_a_step_then_the_filter_is_not_spoiled(step):
    """The filter catches a jump at once: that is why the drift is the default."""
    errors, sim = step
    assert over(errors, "filter", 30, 80) < 1.3 * over(errors, "filter", 10, 29)
    assert sim["test.innovation.gps.alarm"][29].mean() >= 0.99


def test_the_satellite_is_named_in_every_run(drift, step):
    for _, sim in (drift, step):
        assert {e.run for e in sim.events if e.kind == "subsystem.isolated" and e.subject == "gps.D3"} == set(
            range(100)
        )
        assert sim.score().faults[0].isolated_share == 1.0
