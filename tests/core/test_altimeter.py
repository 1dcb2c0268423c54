"""System A's altimeter as a tested aid: what its damping does to the filters, its test, its way out and back."""

import numpy as np
import pytest
from scipy.stats import chi2

from ftcore import Fault, Scenario, Simulation
from ftcore.detection import supervisor
from ftcore.estimation import ins_error, kalman
from ftcore.estimation.federated import Estimate
from ftcore.systems.sins_gps_doppler import altimeter, bank
from ftcore.systems.sins_gps_doppler.bank import CENTRAL, INS_OF_FILTER, SIZE, WITNESS, Filters
from ftcore.systems.sins_gps_doppler.forms import Settings
from ftcore.systems.sins_gps_doppler.strapdowns import Damping

CALM = Scenario.load("zhang-1992").model_copy(update={"faults": (), "duration": 150.0})
RULES = supervisor.Rules(2, 3, 1, 5)
N = ins_error.STATES
CHANNEL = "altimeter.height.up"


def random_bank(rng, runs):
    L = rng.normal(size=(runs, SIZE, N, N))
    return Filters(rng.normal(size=(runs, SIZE, N)), L @ L.swapaxes(-1, -2) + np.eye(N))


def taken(rng, runs, protected=True):
    reading = Damping(
        rng.normal(5000.0, 50.0, runs), rng.normal(0.0, 20.0, (runs, 2)), np.ones(runs, bool), np.zeros((runs, 2, 2))
    )
    return reading.trusted(np.full(runs, protected), (0.07, 0.001))


# ---- what damping does to the filters


def test_given_a_trusted_reading_then_filters_are_damped_as_the_transition_matrix_says():
    """P <- D P D' + noise, with D and the noise of ftcore.estimation.ins_error, which have oracles of their own."""
    rng = np.random.default_rng(1)
    before, damping = random_bank(rng, 3), taken(rng, 3)
    factors = np.array([[2.0, 2.0, 1.0]])
    after = bank.damp(before, damping, 4.0, factors)
    k1, k2 = np.moveaxis(damping.gains[:, INS_OF_FILTER[:WITNESS]], -1, 0)
    D = ins_error.damping_transition(damping.height[:, None], 1.0, k1, k2)
    sigma = 2.0 * np.sqrt(np.append(factors[0], np.ones(WITNESS - 3)))
    P = D @ before.P[:, :WITNESS] @ D.swapaxes(-1, -2) + ins_error.damping_noise(1.0, k1, k2, sigma)
    np.testing.assert_allclose(after.x[:, :WITNESS], np.matvec(D, before.x[:, :WITNESS]), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(after.P[:, :WITNESS], P, rtol=1e-9, atol=1e-6)
    assert np.array_equal(after.P, after.P.swapaxes(-1, -2)), "exactly symmetric"


def test_given_a_trusted_reading_then_the_witness_measures_it_and_knows_by_how_much_the_strapdown_was_moved():
    rng = np.random.default_rng(2)
    before, damping = random_bank(rng, 3), taken(rng, 3)
    after = bank.damp(before, damping, 4.0, np.ones((1, 3)))
    a = altimeter.row(damping, N)
    update = kalman.update(
        before.x[:, WITNESS], before.P[:, WITNESS], damping.above[:, :1], a[:, None], np.array([[4.0]])
    )
    moved = np.zeros((3, N))
    moved[:, [2, 5]] = damping.gains[:, 0] * damping.above[:, :1]
    np.testing.assert_allclose(after.x[:, WITNESS], update.x - moved, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(after.P[:, WITNESS], update.P, rtol=1e-9, atol=1e-6)


def test_given_a_withheld_reading_then_only_the_unprotected_filter_is_damped():
    rng = np.random.default_rng(3)
    before, damping = random_bank(rng, 3), taken(rng, 3, protected=False)
    after = bank.damp(before, damping, 4.0, np.ones((1, 3)))
    moved = [i for i in range(SIZE) if not np.array_equal(before.P[:, i], after.P[:, i])]
    assert moved == [CENTRAL]


def test_given_a_reading_known_to_have_been_wrong_then_its_damping_is_a_known_input():
    """By its metres, whatever it read; no uncertainty is added or taken away."""
    rng = np.random.default_rng(4)
    before, damping = random_bank(rng, 3), taken(rng, 3)
    after = bank.damp(before, damping, 4.0, np.ones((1, 3)), wrong=np.array([True, False, True]))
    right = bank.damp(before, damping, 4.0, np.ones((1, 3)))
    protected = np.flatnonzero(INS_OF_FILTER == 0)
    moved = np.zeros((3, 1, N))
    moved[:, 0, [2, 5]] = damping.gains[:, 0] * damping.above[:, :1]
    for run in (0, 2):
        np.testing.assert_allclose(after.x[run, protected], before.x[run, protected] - moved[run], rtol=1e-12)
        assert np.array_equal(after.P[run, protected], before.P[run, protected])
    assert np.array_equal(after.P[1], right.P[1])


# ---- the test, by itself


def judged(state, above, height=5000.0, variance=1.0, known=1.0, present=True, settings=None):
    """One epoch of runs whose witness predicts 0 with variance `known` of height, and of nothing else."""
    above = np.asarray(above, dtype=float)
    runs = len(above)
    P = np.zeros((runs, N, N))
    P[:, 2, 2] = known
    reading = Damping(
        np.full(runs, height), np.stack([above, above], axis=-1), np.full(runs, present), np.zeros((runs, 2, 2))
    )
    return altimeter.judge(
        state, Estimate(np.zeros((runs, N)), P), reading, variance, True, settings or Settings(), RULES
    )


def test_given_one_reading_then_its_statistic_is_the_square_over_the_variance_of_the_difference():
    _, epoch = judged(altimeter.start(2), [3.0, 8.0], known=4.0, variance=2.0)
    np.testing.assert_allclose(epoch.statistic[:, 0], [9.0 / 6.0, 64.0 / 6.0])
    np.testing.assert_allclose(epoch.threshold[:, 0], chi2.isf(1e-3, 1), rtol=1e-6)
    assert epoch.used.tolist() == [True, True]
    _, epoch = judged(altimeter.start(2), [3.0, 9.0], known=4.0, variance=2.0)
    assert epoch.alarm[:, 0].tolist() == [False, True]
    assert epoch.used.tolist() == [True, False], "withheld from its first alarm on"


def test_given_no_reading_then_there_is_no_statistic_and_nobody_is_accused():
    _, epoch = judged(altimeter.start(1), [900.0], present=False)
    assert epoch.dof[0, 0] == 0
    assert not epoch.alarm.any()


def test_given_an_isolated_altimeter_that_agrees_then_it_is_back_after_the_hold_off_with_its_bias_reopened():
    """By what the admission could not have seen: threshold times the innovation's variance."""
    state = altimeter.start(1)
    for _ in range(2):
        state, epoch = judged(state, [50.0])
    assert epoch.decision.just_isolated.all()
    for i in range(RULES.hold_off):
        state, epoch = judged(state, [1.0])
        assert epoch.decision.just_readmitted[0, 0] == (i == RULES.hold_off - 1)
    assert epoch.opened[0] == pytest.approx(chi2.isf(1e-3, 1) * 2.0)
    assert epoch.shift[0] == 0.0


def test_given_an_isolated_altimeter_that_differs_by_a_constant_then_that_becomes_its_bias_in_the_end():
    """A fault that was too slow to be seen has ended: without this the altimeter would be out for good."""
    rng = np.random.default_rng(5)
    state = altimeter.start(1)
    for i in range(2 + altimeter.STEADY):
        state, epoch = judged(state, [50.0 + rng.normal()])
        assert epoch.decision.just_readmitted.any() == (i == 1 + altimeter.STEADY)
    assert epoch.shift[0] == pytest.approx(50.0, abs=1.0)


@pytest.mark.parametrize("drift", [0.5, 2.0], ids=["0.5 m/s", "2 m/s"])
def test_given_an_isolated_altimeter_that_goes_on_drifting_then_it_stays_out(drift):
    state = altimeter.start(1)
    for i in range(4 * altimeter.STEADY):
        state, epoch = judged(state, [50.0 + drift * i])
        assert not epoch.decision.just_readmitted.any()


def test_given_the_test_is_switched_off_then_the_height_is_taken_whatever_it_says():
    state = altimeter.start(1)
    for _ in range(5):
        state, epoch = judged(state, [500.0], settings=Settings(altimeter_driving_test="none"))
        assert epoch.alarm.all()
        assert epoch.used.all()


# ---- in flight


def kinds(sim, subject):
    return [e.kind for e in sim.events if e.subject == subject]


def test_given_100_m_then_the_altimeter_alone_is_isolated_and_comes_back_and_the_height_is_right():
    """The issue's own case, three runs of its seed. Five sigma of three runs: false failure 2e-6."""
    fault = Fault(channel=CHANNEL, kind="bias", magnitude=100.0, start=50.0, end=80.0)
    sim = Simulation(CALM.model_copy(update={"faults": (fault,)}), runs=3, seed=9961).advance(until=110.0)
    isolated = [(e.time, e.subject) for e in sim.events if e.kind == "subsystem.isolated"]
    assert {subject for _, subject in isolated} == {"altimeter"}
    assert all(50.0 <= time <= 53.0 for time, _ in isolated)
    assert (sim["used.altimeter"][54:79] == 0.0).all()
    assert (sim["used.altimeter"][89:] == 1.0).all()
    error, sigma = sim["fused.error.position.up"], sim["fused.sigma.position.up"]
    assert (np.abs(error[54:]) < 5.0 * sigma[54:]).all()
    assert np.abs(sim["unprotected.error.position.up"][64]).min() > 20.0, "the fault was there to be noticed"


def test_given_two_propagators_drive_and_300_m_on_the_altimeter_then_gps_is_used_throughout():
    fault = Fault(channel=CHANNEL, kind="bias", magnitude=300.0, start=20.0, end=35.0)
    scenario = CALM.model_copy(update={"faults": (fault,), "settings": {"driving_test": "two-propagator"}})
    sim = Simulation(scenario, runs=2, seed=7).advance(until=80.0)
    assert {e.subject for e in sim.events if e.kind == "subsystem.isolated"} == {"altimeter"}
    assert sim["used.gps"].mean() > 0.98


def test_given_the_altimeter_is_isolated_then_page_and_events_say_so():
    fault = Fault(channel=CHANNEL, kind="bias", magnitude=60.0, start=20.0)
    sim = Simulation(CALM.model_copy(update={"faults": (fault,)}), seed=3).advance(until=25.0)
    assert sim.subsystems["altimeter"].health == "isolated"
    assert not sim.subsystems["altimeter"].used
    view = sim.view()
    assert view.blocks["altimeter-fdi"].text == "excluded"
    assert view.blocks["altimeter"].health == "faulted"
    named = [e for e in sim.events if e.kind == "channel.named" and e.subject == "altimeter.height"]
    assert named[0].detail["estimated_fault [m]"] == pytest.approx(60.0, abs=15.0)
    score = sim.score()
    assert score.faults[0].isolated == ["altimeter"]
    assert score.faults[0].time_to_alarm["altimeter"] is not None


def test_given_the_altimeter_is_switched_off_and_on_then_it_is_no_suspect():
    sim = Simulation(CALM, seed=3).advance(until=30.0)
    sim.switch("altimeter", False).advance(until=40.0)
    assert np.isnan(sim["test.altimeter.altimeter.statistic"][30:40]).all()
    sim.switch("altimeter", True).advance(until=50.0)
    assert "subsystem.isolated" not in kinds(sim, "altimeter")
    assert sim["used.altimeter"][-1, 0] == 1.0


def test_given_no_altimeter_noise_at_all_then_it_still_flies():
    scenario = CALM.model_copy(update={"parameters": {"aiding": {"altimeter_noise": 0.0}}})
    sim = Simulation(scenario, seed=3).advance(until=40.0)
    assert np.isfinite(sim["fused.error.position.up"]).all()
