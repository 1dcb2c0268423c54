"""The SINS/GPS/Doppler system: what its settings do, on single flights."""

import numpy as np
import pytest
from scipy.stats import binom, chi2

from ftcore import CommandError, Fault, Scenario, Simulation
from ftcore.detection import supervisor
from ftcore.estimation import least_squares
from ftcore.systems.sins_gps_doppler import satellites
from ftcore.systems.sins_gps_doppler.aids import SLOTS, Aid
from ftcore.systems.sins_gps_doppler.bank import SIZE, Filters
from ftcore.systems.sins_gps_doppler.forms import Settings

CALM = Scenario.load("zhang-1992").model_copy(update={"faults": ()})
RULES = supervisor.Rules(2, 3, 1, 5)


def integrity(mode, **settings):
    return CALM.model_copy(update={"settings": {"satellite_integrity": mode} | settings})


def kinds(sim, subject):
    return [e.kind for e in sim.events if e.subject == subject]


# ---- satellite-level integrity


def received(rng, runs=20, n=7, turning=2e-4):
    """Ranges and rates of n satellites, whose lines of sight turn with the position error, and a bank of filters."""
    e = rng.normal(size=(n, 3))
    e[:, 2] = np.abs(e[:, 2]) + 0.3
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    H = np.zeros((2 * n, 21))
    H[:n, :3], H[:n, 19], H[n:, 3:6], H[n:, 20] = e, 1.0, e, 1.0
    H[n:, :3] = turning * rng.normal(size=(n, 3))
    R = np.repeat([100.0, 0.01], n)
    state = np.zeros((runs, 21))
    state[:, [0, 1, 2, 19]] = rng.normal(size=(runs, 4)) * [30.0, 30.0, 30.0, 800.0]
    state[:, [3, 4, 5, 20]] = rng.normal(size=(runs, 4)) * [1.0, 1.0, 1.0, 10.0]
    y = state @ H.T + rng.normal(size=(runs, 2 * n)) * np.sqrt(R)
    valid = rng.random((runs, 2 * n)) > 0.1
    columns = np.concatenate([np.arange(n), np.arange(n) + len(SLOTS)])
    everything = np.broadcast_to(H, (runs, 2, 2 * n, 21))
    aid = Aid(np.repeat(y[:, None], 2, axis=1), everything, R[None, None], valid, valid, columns)
    P = np.zeros((runs, SIZE, 21, 21))
    P[:] = np.diag([1.0] * 6 + [1e-6] * 13 + [1.0, 1.0])
    return aid, Filters(np.zeros((runs, SIZE, 21)), P), state


def test_given_everything_is_unknown_then_the_statistic_is_that_of_least_squares():
    """Residuals of ranges and of rates, each with four unknowns. Infinite is 1e5 m: the clock, 800 m off, costs its
    square over that, 1e-4, and more where satellites hardly tell it from height."""
    aid, filters, _ = received(np.random.default_rng(3), turning=0.0)
    n = len(aid.columns) // 2
    _, epoch = satellites.step(satellites.start(20), aid, filters, Settings(satellite_integrity="snapshot"), RULES)
    G = np.concatenate([aid.H[:, 0, :n, :3], np.ones((20, n, 1))], axis=-1)
    ranges = least_squares.solve(G, aid.y[:, 0, :n], np.full((20, n), 10.0), aid.valid[:, :n])
    rates = least_squares.solve(G, aid.y[:, 0, n:], np.full((20, n), 0.1), aid.valid[:, n:])
    full = ranges.solved & rates.solved
    assert full.sum() > 5
    assert np.array_equal(epoch.dof[full, 0], (ranges.dof + rates.dof)[full])
    assert np.allclose(epoch.statistic[full, 0], (ranges.statistic + rates.statistic)[full], rtol=1e-5, atol=2e-3)


def test_given_a_wrong_satellite_then_both_of_its_rows_go_and_only_its():
    aid, filters, state = received(np.random.default_rng(4))
    filters.x[...] = state[:, None]  # the prediction is right, but for the clock, which counts for nothing
    filters.x[..., 19:] = 0.0
    aid.valid[...] = True
    aid.y[:, :, 2] += 150.0
    _, epoch = satellites.step(satellites.start(20), aid, filters, Settings(satellite_integrity="innovation"), RULES)
    n = len(aid.columns) // 2
    expected = np.ones(2 * n, bool)
    expected[[2, n + 2]] = False
    assert np.array_equal(epoch.gps.valid, np.broadcast_to(expected, (20, 2 * n)))
    assert epoch.gps.present.all(), "what was read is not forgotten: the unprotected filter takes it"
    assert not epoch.used[:, 2].any()


def test_given_half_of_the_satellites_are_wrong_then_nobody_is_accused():
    """Four of seven, each its own way: a majority is never left out, whatever would fit best."""
    aid, filters, state = received(np.random.default_rng(5))
    filters.x[...] = state[:, None]
    aid.valid[...] = True
    aid.y[:, :, :4] += np.array([400.0, -300.0, 900.0, -700.0])
    _, epoch = satellites.step(satellites.start(20), aid, filters, Settings(satellite_integrity="innovation"), RULES)
    assert epoch.alarm.all()
    assert epoch.gps.valid.all()
    assert [n.kind for n in epoch.notices] == ["integrity.cannot-isolate"]


def test_given_too_few_satellites_to_tell_then_it_says_so_and_guesses_nobody():
    """Five satellites, positions unknown: one degree of freedom for the ranges shows that one is off, but not who."""
    sim = Simulation(integrity("snapshot", driving_test="none")).advance(until=40)
    visible = [s for s in SLOTS if sim[f"used.gps.{s}"][-1, 0] > 0]
    for slot in [s for s in visible if s != "C1"][:-4]:
        for quantity in ("pseudorange", "delta_range"):
            sim.inject(Fault(channel=f"gps.{quantity}.{slot}", kind="dropout"))
    sim.inject(Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=500.0))
    sim.advance(epochs=5)
    assert sim["gps.satellites"][-1, 0] == 5
    assert "integrity.cannot-isolate" in kinds(sim, "gps")
    assert not [e for e in sim.events if e.kind == "subsystem.isolated" and e.subject.startswith("gps.")]


def test_given_the_same_five_satellites_then_the_strapdown_tells_who_it_is():
    sim = Simulation(integrity("innovation", driving_test="none")).advance(until=70)
    visible = [s for s in SLOTS if sim[f"used.gps.{s}"][-1, 0] > 0]
    for slot in [s for s in visible if s != "C1"][:-4]:
        for quantity in ("pseudorange", "delta_range"):
            sim.inject(Fault(channel=f"gps.{quantity}.{slot}", kind="dropout"))
    sim.inject(Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=500.0))
    sim.advance(epochs=5)
    assert "subsystem.isolated" in kinds(sim, "gps.C1")
    assert sim["gps.excluded"][-1, 0] == 1.0
    assert sim["gps.satellites"][-1, 0] == 4.0


def test_given_integrity_is_switched_off_in_flight_then_the_satellite_is_back_at_once_and_the_event_says_so():
    sim = Simulation(integrity("innovation", driving_test="none")).advance(until=40)
    sim.inject(Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=200.0))
    sim.advance(until=50)
    assert sim.view().items["satellite.C1"].health == "isolated"
    sim.configure(satellite_integrity="off")
    sim.step()
    assert sim["used.gps.C1"][-1, 0] == 1.0
    assert kinds(sim, "gps.C1")[-1] == "subsystem.readmitted"
    assert np.isnan(sim["test.integrity.gps.statistic"][-1, 0])


@pytest.mark.parametrize("mode", ["snapshot", "innovation"])
def test_given_integrity_leaves_a_satellite_out_then_the_unprotected_filter_does_not_profit(mode):
    """To the last bit: it is what happens to somebody who knows of no integrity."""
    fault = Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=100.0, start=30.0)
    flights = [
        Simulation(integrity(m).model_copy(update={"faults": (fault,)}), runs=2).advance(until=50)
        for m in (mode, "off")
    ]
    assert not np.array_equal(*(s["fused.error.position.up"] for s in flights))
    assert np.array_equal(*(s["unprotected.error.position.up"] for s in flights))


def test_given_gps_has_no_reading_for_a_while_then_integrity_waits_and_goes_on():
    sim = Simulation(integrity("innovation")).advance(until=30)
    for quantity in ("pseudorange", "delta_range"):
        sim.inject(Fault(channel=f"gps.{quantity}.all", kind="dropout", end=50.0))
    sim.advance(until=70)
    gone = (sim.time > 31) & (sim.time < 50)
    assert np.isnan(sim["test.integrity.gps.statistic"][gone]).all()
    assert not [k for k in kinds(sim, "gps") if k.startswith("integrity")]
    assert sim["used.gps"][-10:, 0].all()


# ---- masters


def with_settings(**settings):
    return CALM.model_copy(update={"settings": settings})


def test_given_nobody_is_doubted_then_the_tolerant_master_is_the_federated_one():
    """With fusion-reset the merge of local filters is the centralised filter, and so is the update with both aids."""
    a, b = (
        Simulation(with_settings(master=master, driving_test="none"), runs=2).advance(until=40)
        for master in ("federated", "tolerant")
    )
    for part in ("position.up", "velocity.east", "attitude.up"):
        for what in ("error", "sigma"):
            assert np.allclose(a[f"fused.{what}.{part}"], b[f"fused.{what}.{part}"], rtol=1e-4, atol=1e-7), part
    assert np.allclose(b["weight.gps+doppler"], 1.0)


def test_given_an_aid_is_in_doubt_then_the_tolerant_master_takes_it_in_part_without_an_alarm():
    """Between the two quantiles, 10 % and 0.1 %, beta falls in a straight line."""
    sim = Simulation(with_settings(master="tolerant", driving_test="residual"), runs=20).advance(until=60)
    q, dof = sim["test.residual.gps.statistic"], sim["test.residual.gps.dof"]
    doubt, reject = chi2.isf(0.1, dof), chi2.isf(1e-3, dof)
    between = (q > doubt) & (q < reject) & (sim["used.gps"] > 0)
    assert between.sum() > 50
    beta = sim["weight.gps"] + sim["weight.gps+doppler"]
    assert np.allclose(beta[between], ((reject - q) / (reject - doubt))[between], rtol=1e-6)
    assert np.allclose(sum(sim[f"weight.{s}"] for s in ("sins", "gps", "doppler", "gps+doppler")), 1.0)


def test_given_a_rejected_aid_then_the_weights_say_so_under_every_master():
    fault = Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=100.0, start=30.0)
    for master in ("federated", "covariance-intersection", "tolerant"):
        scenario = with_settings(master=master).model_copy(update={"faults": (fault,)})
        sim = Simulation(scenario).advance(until=40)
        assert sim["weight.gps"][-1, 0] == sim["weight.gps+doppler"][-1, 0] == 0.0
        assert sim["weight.doppler"][-1, 0] > 0.0


def test_given_the_master_is_changed_in_flight_then_the_estimate_does_not_jump():
    """The filters of each master are kept ready by the others."""
    sim = Simulation(CALM, runs=4).advance(until=40)
    for master in ("tolerant", "federated"):
        sim.configure(master=master)
        sim.advance(epochs=20)
    moved = np.abs(np.diff(sim["fused.error.position.up"], axis=0))
    assert moved[38:].max() < 3.0 * moved[25:38].max()


def test_given_doubt_that_begins_after_rejection_then_it_is_refused():
    sim = Simulation(CALM)
    with pytest.raises(CommandError, match="doubt begins before rejection"):
        sim.configure(master="tolerant", doubt_probability=1e-4)


# ---- a second fault in the redundant IMU


def test_given_one_accelerometer_is_out_then_a_second_fault_is_announced_and_nobody_else_is_accused():
    """10 mg on another instrument: two are left, and both explain the disagreement equally well."""
    sim = Simulation(CALM, runs=2).advance(until=20)
    sim.inject(Fault(channel="imu.accelerometer.3y", kind="bias", magnitude=5.0, unit="mg"))
    sim.advance(until=30)
    assert kinds(sim, "imu.accelerometer.3").count("subsystem.isolated") == 2
    assert np.isnan(sim["test.parity-trusted.imu.accelerometer.statistic"][:18]).all(), "silent while all are trusted"
    assert (sim["test.parity-trusted.imu.accelerometer.dof"][-5:] == 1.0).all()
    assert "integrity.cannot-isolate" not in kinds(sim, "imu.accelerometer")
    sim.inject(Fault(channel="imu.accelerometer.1x", kind="bias", magnitude=10.0, unit="mg", end=40.0))
    sim.advance(until=39)
    found = [e for e in sim.events if e.kind == "integrity.cannot-isolate"]
    assert {(e.run, e.subject) for e in found} == {(0, "imu.accelerometer"), (1, "imu.accelerometer")}
    assert all(e.time <= 33.0 and e.detail["statistic"] > e.detail["threshold"] for e in found)
    assert {e.subject for e in sim.events if e.kind == "subsystem.isolated" and "imu" in e.subject} == {
        "imu.accelerometer.3"
    }
    assert "cannot isolate" in sim.view().blocks["imu-fdi"].text
    sim.advance(until=60)
    assert "integrity.restored" in kinds(sim, "imu.accelerometer")


def test_given_an_accelerometer_without_readings_then_a_fault_of_another_is_seen_but_nobody_is_named():
    sim = Simulation(CALM).advance(until=20)
    for axis in "xy":
        sim.inject(Fault(channel=f"imu.accelerometer.2{axis}", kind="dropout"))
    sim.advance(until=30)
    assert not [e for e in sim.events if e.kind.startswith("integrity")]
    assert sim["test.parity.imu.accelerometer.dof"][-1, 0] == 1.0
    sim.inject(Fault(channel="imu.accelerometer.3y", kind="bias", magnitude=10.0, unit="mg"))
    sim.advance(until=40)
    assert "integrity.cannot-isolate" in kinds(sim, "imu.accelerometer")
    assert not [e for e in sim.events if e.kind == "subsystem.isolated" and "imu" in e.subject]


def test_given_one_gyro_is_out_then_the_rest_cries_wolf_as_rarely_as_asked_for():
    """99 runs of 80 epochs with P_fa = 1e-3, one degree of freedom. False failure 1e-4; the calibration's own error,
    common to all epochs of a run, adds little (it is an eighth of the noise)."""
    fault = Fault(channel="imu.gyro.2x", kind="bias", magnitude=200.0, unit="deg/h", start=5.0)
    scenario = CALM.model_copy(update={"faults": (fault,), "duration": 90.0})
    sim = Simulation(scenario, runs=99).advance()
    judged = sim["test.parity-trusted.imu.gyro.dof"] == 1.0
    alarm = sim["test.parity-trusted.imu.gyro.alarm"][judged] > 0.0
    assert judged.sum() > 99 * 80
    low, high = binom.ppf([5e-5, 1 - 5e-5], alarm.size, 1e-3)
    assert low <= alarm.sum() <= high
    p = chi2.sf(sim["test.parity-trusted.imu.gyro.statistic"][-1], 1)
    low, high = binom.ppf([5e-5, 1 - 5e-5], p.size, 0.1)
    assert low <= (p < 0.1).sum() <= high
