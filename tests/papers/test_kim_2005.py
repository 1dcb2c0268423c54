"""H.S. Kim, S.K. Park, Y. Kim and C.G. Park, IFAC 2005: the claims of section 5, over 20 runs, and the other scenarios.

Figures of the paper: 5 FD, 6 FI, 7 UKF residuals, 8 flight path. Everything is seeded; where a number is statistical
the probability that a correct system fails the test is below 1e-6.
"""

import numpy as np
import pytest
from scipy.stats import binom, chi2, ncx2

from ftcore import Scenario, Simulation
from ftcore.detection.geometry import improve_angles

RUNS = 20
FALSE_FAILURE = 1e-6


def fly(name, runs=RUNS, until=None, **changes):
    scenario = Scenario.load(name)
    return Simulation(scenario.model_copy(update=changes) if changes else scenario, runs=runs).advance(until=until)


def isolations(sim):
    """(run, gyro) -> time of the first isolation."""
    found = {}
    for e in sim.events:
        if e.kind == "subsystem.isolated":
            found.setdefault((e.run, int(e.subject[-1])), e.time)
    return found


@pytest.fixture(scope="module")
def kim():
    return fly("kim-2005")


def test_section_3_every_random_start_climbs_to_the_index_of_the_paper():
    angles, index = improve_angles(np.random.default_rng(1).uniform(0.0, np.pi, (100, 3)))
    assert index.min() > 3.999  # (28): J_FDI = 4
    np.testing.assert_allclose(np.rad2deg(angles) % 90.0, 45.0, atol=0.01)


def test_figure_5_fd_crosses_its_threshold_at_once(kim):
    FD = kim["test.parity.imu.gyro.statistic"]
    limit = kim["test.parity.imu.gyro.threshold"]
    assert limit[0, 0] * 0.01**2 == pytest.approx(0.00163, abs=5e-6)  # T_D of systems.md, (rad/s)^2
    onset = np.searchsorted(kim.time, 1.0 - 1e-9)
    assert ncx2.cdf(limit[0, 0], 3, 0.1**2 / 0.01**2) < 1e-8, "that the fault is missed in an epoch"
    assert (FD[onset:] > limit[onset:]).all()
    before = np.count_nonzero(FD[:onset] > limit[:onset])
    assert before <= binom.isf(FALSE_FAILURE, onset * RUNS, 1e-3)
    assert np.median(FD[onset:]) == pytest.approx(ncx2.median(3, 100.0), rel=0.02)


def test_figure_6_fi_of_sensors_1_and_3_both_fall_below_their_threshold(kim):
    after = kim.time >= 1.0
    FI = {k: np.rad2deg(kim[f"test.isolation-angle.imu.gyro.{k}.statistic"][after]) for k in (1, 2, 3)}
    for k in (1, 3):
        assert (FI[k] < 15.0).mean() > 0.97
        assert np.median(FI[k]) < 6.0
    assert FI[2].min() > 45.0
    both = (FI[1] < 15.0) & (FI[3] < 15.0)
    assert both.mean() > 0.95, "parity space alone declares two gyros"


def test_figure_7_the_ukf_residual_is_large_for_sensor_1_only(kim):
    after = kim.time >= 1.04
    guilty, innocent = (kim[f"test.ukf.imu.gyro.{k}.alarm"][after] for k in (1, 3))
    judged = {k: np.isfinite(kim[f"test.ukf.imu.gyro.{k}.statistic"][after]) for k in (1, 3)}
    assert judged[1].mean() > 0.95
    assert guilty[judged[1]].mean() > 0.99
    assert innocent[judged[3]].mean() < 0.01
    for axis, size in (("1x", 0.1), ("1y", 0.1), ("3x", 0.0), ("3y", 0.0)):
        residual = kim[f"residual.ukf.{axis}"][after]
        assert np.nanmean(residual) == pytest.approx(size, abs=0.02)


def test_only_sensor_1_is_isolated_in_every_run_and_soon(kim):
    found = isolations(kim)
    assert set(found) == {(run, 1) for run in range(RUNS)}
    assert max(found.values()) <= 1.1


def test_figure_8_with_fdi_the_flight_path_is_the_healthy_one_within_metres_and_without_it_is_not(kim):
    assert kim["protected.distance"].max() < 10.0
    assert kim["unprotected.distance"][-1].min() > 100.0
    # Figures 3 and 8: a climb of 120 ft/s for 5 s, then a turn.
    height = kim["height.protected"]
    at = [np.searchsorted(kim.time, t - 1e-9) for t in (1.0, 5.0)]
    np.testing.assert_allclose(height[at[1]] - height[at[0]], 4.0 * 120 * 0.3048, rtol=0.05)
    assert abs(np.rad2deg(kim["truth.roll"][-1]) - 45.0).max() < 5.0


def test_the_score_counts_it_as_found_and_named(kim):
    score = kim.score()
    for fault in score.faults:
        assert fault.time_to_alarm["parity"] == pytest.approx(0.0, abs=1e-9)
        assert fault.isolated == ["imu.gyro.1"]
        assert fault.wrong_isolations == []
        assert fault.isolated_share == 1.0


# ---- the other ready scenarios


def test_without_the_ukf_two_gyros_are_declared_nobody_can_be_isolated_and_the_path_is_lost():
    sim = fly("kim-2005-conventional", runs=8)
    said = [e for e in sim.events if e.kind == "integrity.cannot-isolate"]
    assert {e.run for e in said} == set(range(8))
    assert all(e.time < 1.2 for e in said[:8])
    assert max(e.detail["suspects"] for e in said) == 2.0
    assert not isolations(sim)
    assert sim["protected.distance"][-1].min() > 100.0
    # All gyros are used: least squares lets half of the fault through, by (27) f/2 (H_1x + H_1y), along one body axis.
    rates = np.stack([sim[f"protected.error.rate.{part}"][60:].mean(axis=0) for part in ("roll", "pitch", "yaw")])
    np.testing.assert_allclose(np.linalg.norm(rates, axis=0), 0.1 / np.sqrt(2.0), rtol=0.05)


def test_a_single_axis_fault_needs_no_ukf():
    sim = fly("kim-2005-single-axis", runs=8, until=1.5)
    found = isolations(sim)
    assert set(found) == {(run, 2) for run in range(8)}
    asked = [e for e in sim.events if e.kind == "filter.started" and 1.0 <= e.time <= found[e.run, 2]]
    assert len(asked) <= 1
    FI = np.rad2deg([sim[f"test.isolation-angle.imu.gyro.{k}.statistic"][50:].mean() for k in (1, 2, 3)])
    assert FI[1] < 6.0
    np.testing.assert_allclose(FI[[0, 2]], 45.0, atol=3.0)


@pytest.mark.long
def test_every_singular_direction_is_told_apart_and_every_gyro_trusted_again():
    sim = fly("kim-2005-singular", runs=5)
    order = [1, 1, 2, 2, 3, 3]
    for run in range(5):
        events = [e for e in sim.events if e.run == run]
        named = [(e.time, int(e.subject[-1])) for e in events if e.kind == "subsystem.isolated"]
        assert [gyro for _, gyro in named] == order
        np.testing.assert_allclose([t for t, _ in named], 1.0 + 2.4 * np.arange(6), atol=0.1)
        assert [int(e.subject[-1]) for e in events if e.kind == "subsystem.readmitted"] == order
    assert sim["protected.distance"].max() < 10.0


@pytest.mark.long
def test_two_failures_one_after_the_other_are_both_placed():
    sim = fly("kim-2005-two-failures", runs=8)
    found = isolations(sim)
    assert set(found) == {(run, gyro) for run in range(8) for gyro in (1, 2)}
    assert all(7.0 <= t < 7.5 for (_, gyro), t in found.items() if gyro == 2)
    assert sim["protected.distance"].max() < 40.0
    assert sim["unprotected.distance"][-1].min() > 100.0


@pytest.mark.long
def test_a_slow_drift_is_found_late_and_mostly_placed():
    sim = fly("kim-2005-drift")
    found = isolations(sim)
    assert len({run for run, gyro in found if gyro == 1}) >= 15
    assert 3.0 < np.median(list(found.values())) < 6.0
    assert np.median(sim["protected.distance"][-1]) < 20.0


@pytest.mark.long
def test_the_ideal_case_is_no_worse_than_with_mismatch(kim):
    ideal = fly("kim-2005-ideal", runs=8)
    assert set(isolations(ideal)) == {(run, 1) for run in range(8)}
    innocent = ideal["test.ukf.imu.gyro.3.statistic"]
    assert np.nanmean(innocent) < np.nanmean(kim["test.ukf.imu.gyro.3.statistic"][:, :8])
    assert np.nanmean(innocent) < chi2.mean(2)


def test_with_a_model_too_far_off_the_ukf_blames_the_innocent():
    sim = fly("kim-2005-mismatch", runs=8, until=8.0)
    found = isolations(sim)
    assert sum((run, 3) in found for run in range(8)) >= 6
    assert any(e.kind == "integrity.cannot-isolate" for e in sim.events)


@pytest.mark.long
def test_on_jsbsims_aircraft_gyro_1_is_named_and_the_path_kept_as_well():
    pytest.importorskip("jsbsim", reason="jsbsim is not installed")
    sim = fly("kim-2005-jsbsim")
    found = isolations(sim)
    assert set(found) == {(run, 1) for run in range(RUNS)}
    assert max(found.values()) <= 1.1
    assert sim["protected.distance"].max() < 15.0
    assert sim["unprotected.distance"][-1].min() > 300.0
    judged = np.isfinite(sim["test.ukf.imu.gyro.3.statistic"][52:])
    assert sim["test.ukf.imu.gyro.3.alarm"][52:][judged].mean() < 0.01
