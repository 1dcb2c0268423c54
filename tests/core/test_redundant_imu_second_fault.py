"""A second fault, faults that meet, and gyros that come back: never fewer gyros than it takes, never for ever.

Where nothing else is said a wrong isolation in the healthy part of a flight comes by chance in less than 1e-4 of runs.
"""

from __future__ import annotations

import numpy as np
import pytest

from ftcore import Simulation
from ftcore.detection import geometry, parity
from tests.redundant_imu import bias, pair, scenario

GYROS = ("imu.gyro.1", "imu.gyro.2", "imu.gyro.3")


def ramp(axis, magnitude, start, end):
    return {"channel": f"imu.gyro.{axis}", "kind": "ramp", "magnitude": magnitude, "start": start, "end": end}


def dropout(axis, start, end=None):
    return {"channel": f"imu.gyro.{axis}", "kind": "dropout", "start": start, "end": end}


def named(sim, kind):
    """(run, gyro) to the times of these events."""
    found = {}
    for e in sim.events:
        if e.kind == kind:
            found.setdefault((e.run, e.subject), []).append(e.time)
    return found


def used(sim, start, end):
    """Share of the epochs in start < t <= end in which each gyro was used, (3, runs)."""
    inside = (sim.time > start) & (sim.time <= end)
    return np.array([sim[f"used.{gyro}"][inside].mean(axis=0) for gyro in GYROS])


def rate_error(sim, start, end):
    """Root mean square of the length of the error of the rates that are flown on, (runs,)."""
    inside = (sim.time > start) & (sim.time <= end)
    parts = [sim[f"protected.error.rate.{part}"][inside] for part in ("roll", "pitch", "yaw")]
    return np.sqrt(np.mean(np.sum(np.square(parts), axis=0), axis=0))


SOUND = 0.01 * np.sqrt(1.5)
"""Error of the rates of three sound gyros: three axes of sigma / sqrt(2)."""


def test_given_two_drifts_without_the_ukf_that_have_ended_then_all_three_gyros_are_used_again():
    """The flight of issue 10, C 9: it locked all out but one."""
    drifts = [ramp("3x", 0.217, 1.39, 5.15), ramp("1x", 0.053, 0.26, 3.39)]
    sim = Simulation(scenario(drifts, 8.0, seed=9980, hybrid=False, driving_test="optimal-parity"), runs=8).advance()
    assert used(sim, 6.5, 8.0).min() > 0.95
    np.testing.assert_allclose(rate_error(sim, 6.5, 8.0), SOUND, rtol=0.2)
    assert {run for run, _ in named(sim, "integrity.cannot-isolate")} == set(range(8))


@pytest.mark.parametrize("driver", ["isolation-angle", "fault-plane", "glt", "optimal-parity"])
@pytest.mark.parametrize("hybrid", [False, True])
def test_given_two_gyros_fail_at_once_and_recover_then_all_three_are_used_again(driver, hybrid):
    faults = [*pair(1, start=0.5, end=1.5), bias("3y", -0.3, 0.5, 1.5)]
    sim = Simulation(scenario(faults, 3.0, hybrid=hybrid, driving_test=driver), runs=4).advance()
    assert used(sim, 2.4, 3.0).min() > 0.9
    np.testing.assert_allclose(rate_error(sim, 2.4, 3.0), SOUND, rtol=0.2)


@pytest.mark.parametrize("hybrid", [False, True])
def test_given_a_second_gyro_fails_when_the_first_has_recovered_then_the_isolation_moves_on(hybrid):
    """The first returns although the trusted two disagree: without the second all would agree."""
    faults = [bias("1x", 0.2, 0.5, 1.5), bias("2y", 0.2, 1.4, 3.0)]
    sim = Simulation(scenario(faults, 4.2, hybrid=hybrid), runs=6).advance()
    back, out = named(sim, "subsystem.readmitted"), named(sim, "subsystem.isolated")
    for run in range(6):
        assert out[run, GYROS[0]][0] < 0.7
        assert 2.0 - 0.05 <= back[run, GYROS[0]][0] < 2.6
        assert 1.4 <= out[run, GYROS[1]][0] < 2.7
        assert 3.5 - 0.05 <= back[run, GYROS[1]][0] < 4.1
        assert (run, GYROS[2]) not in out
    assert used(sim, 2.8, 3.0)[1].max() == 0.0


def test_given_a_second_fault_without_the_ukf_then_it_is_said_nobody_else_goes_and_the_best_pair_flies():
    """Gyro 1 is far off and out; gyro 2 fails by less. Without gyro 1 the others agree best, better than any other two:
    the error is at most what a fault of gyro 2 does to the rates of gyros 2 and 3."""
    faults = [bias("1x", 0.5, 0.5), bias("2y", 0.15, 1.2)]
    sim = Simulation(scenario(faults, 2.2, hybrid=False), runs=6).advance()
    assert set(named(sim, "subsystem.isolated")) == {(run, GYROS[0]) for run in range(6)}
    said = [e for e in sim.events if e.kind == "integrity.cannot-isolate" and e.time > 1.2]
    assert {e.run for e in said} == set(range(6))
    for e in said:
        assert e.detail["dof"] == 1.0
        assert e.detail["suspects"] == 2.0
        assert e.detail["statistic"] >= e.detail["threshold"] == pytest.approx(10.83, abs=0.01)
    view = sim.view()
    assert view.blocks["gyro-1"].text == "isolated, fault"
    assert view.blocks["gyro-3"].text == "in doubt"
    assert view.blocks["supervisor"].text == "gyro 1 out; cannot tell: 2, 3"
    assert used(sim, 1.4, 2.2)[0].max() < 0.05
    assert used(sim, 1.4, 2.2)[1:].min() == 1.0
    gain = geometry.three_two_dof().gains[0b110]
    assert rate_error(sim, 1.4, 2.2).max() < 1.2 * np.hypot(0.15 * np.linalg.norm(gain[:, 3]), 2 * SOUND)


def test_given_a_second_fault_with_the_ukf_then_it_is_isolated_too():
    faults = [bias("1x", 0.5, 0.5), bias("2y", 0.3, 1.2)]
    sim = Simulation(scenario(faults, 2.0), runs=6).advance()
    assert set(named(sim, "subsystem.isolated")) == {(run, gyro) for run in range(6) for gyro in GYROS[:2]}
    assert sim["control.by-ukf"][-1].all()
    assert rate_error(sim, 1.5, 2.0).max() < 0.1


@pytest.mark.parametrize("left", [1, 0])
def test_given_readings_of_fewer_than_two_gyros_without_the_ukf_then_what_is_not_seen_is_held_and_all_come_back(left):
    faults = [dropout(f"{k}x", 0.5, 1.0) for k in range(left + 1, 4)]
    sim = Simulation(scenario(faults, 1.5, hybrid=False), runs=2).advance()
    inside = (sim.time > 0.52) & (sim.time < 0.98)
    rates = np.stack([sim[f"protected.error.rate.{part}"][inside] for part in ("roll", "pitch", "yaw")])
    assert np.abs(rates).max() < 0.3
    assert [sim[f"used.{gyro}"][30].mean() for gyro in GYROS] == [float(k < left) for k in range(3)]
    text = sim.view(at=0.7).blocks["control"].text
    assert text == ("1 gyro, third rate held" if left else "gyro rates held")
    assert used(sim, 1.2, 1.5).min() > 0.9


def test_given_a_long_hold_off_and_a_nervous_test_then_who_is_sound_still_comes_back():
    """At 0.1 an epoch nobody passes 150 epochs in a row (1e-7); so comparisons for the return are surer than alarms."""
    sim = Simulation(
        scenario([bias("2x", 0.5, 0.3, 0.5)], 5.0, hold_off=150, false_alarm_probability=0.1, hybrid=False), runs=2
    ).advance()
    back = named(sim, "subsystem.readmitted")
    assert all(back[run, GYROS[1]][0] >= 3.46 for run in range(2))


# ---- who may come back, as parity space says it


def cluster_reading(fault):
    cluster = geometry.three_two_dof()
    reference = parity.uncalibrated(cluster, 0.01, 0.0)
    rate = np.array([[0.3, -0.2, 0.1]])
    return parity.look(reference, np.matvec(cluster.H, rate) + fault, 1e-3)


def test_given_all_agree_then_everybody_who_is_out_may_come_back():
    trusted = np.array([[False, True, False]])
    assert parity.admission(cluster_reading(np.zeros((1, 6))), trusted, np.array([False]), 1e-3).tolist() == [
        [True, False, True]
    ]


def test_given_one_is_at_fault_then_another_may_come_back_only_where_the_trusted_disagree():
    fault = np.array([[0.0, 0.0, 0.3, 0.1, 0.0, 0.0]])
    sight = cluster_reading(fault)
    without_1, without_2 = np.array([[False, True, True]]), np.array([[True, False, True]])
    assert parity.admission(sight, without_1, np.array([True]), 1e-3).tolist() == [[True, False, False]]
    assert not parity.admission(sight, without_1, np.array([False]), 1e-3).any()
    assert not parity.admission(sight, without_2, np.array([False]), 1e-3).any()
