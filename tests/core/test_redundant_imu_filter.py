"""The UKF as the redundant IMU runs it: filterpy's on the same model and readings, when it starts, what reaches it."""

from itertools import pairwise

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from scipy.stats import chi2, kstest

from ftcore import Simulation
from ftcore.systems.redundant_imu.analytic import AIR_STATES, AXES, L
from ftcore.systems.redundant_imu.model import RATES, flight_model
from ftcore.world.aircraft import S, f16
from tests.redundant_imu import pair, scenario

FALSE_FAILURE = 1e-6


def test_it_is_filterpys_started_three_steps_before_the_alarm_on_the_gyro_that_is_not_suspected_and_air_data():
    """The paper's fault is declared at 1 s, epoch 50: filterpy starts from what was stored of epoch 47."""
    sim = Simulation(scenario(pair(1), 2.0)).advance(until=1.0)
    analytic = sim._assembly.navigator._analytic
    model = flight_model(f16())
    moments = list(sim._state.navigator.episode.past[-4:])  # epochs 47 to 50
    seen = [2, 3, *range(AXES, AXES + len(AIR_STATES))]  # gyro 2's axes and air data
    H = analytic._seen[seen]
    flown = {}
    peer = UnscentedKalmanFilter(
        L,
        len(seen),
        0.02,
        lambda x: H @ x,
        lambda x, dt: model.fly(x[None], flown["power"], flown["u"])[0],
        MerweScaledSigmaPoints(L, 1.0, 2.0, 0.0),
    )
    peer.x, peer.P, peer.Q = moments[0].x[0], analytic._P0.copy(), analytic._Q
    peer.R = np.diag(analytic._R[seen])
    while True:
        for before, after in pairwise(moments):
            flown |= {"power": before.power[0], "u": before.u[0]}
            peer.predict()
            peer.update(after.y[0, seen])
        episode = sim._state.navigator.episode
        sigma = np.sqrt(np.diag(peer.P))
        np.testing.assert_allclose(episode.x[0] / sigma, peer.x / sigma, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            episode.P[0] / np.outer(sigma, sigma), peer.P / np.outer(sigma, sigma), rtol=1e-9, atol=1e-9
        )
        if sim.epoch == 80:
            break
        sim.step()
        moments = [episode.past[-1], sim._state.navigator.episode.past[-1]]
    # The residuals of figure 7, (48)-(49), from filterpy's estimate.
    m = sim._state.navigator.episode.past[-1].y[0, :AXES]
    expected = m - analytic._axes.reshape(AXES, 3) @ peer.x[RATES]
    for i, axis in enumerate(("1x", "1y")):
        np.testing.assert_allclose(sim[f"residual.ukf.{axis}"][-1, 0], expected[i], rtol=1e-9, atol=1e-12)


IDEAL = {"mismatch": {"mass": 0.0, "centre_of_gravity": 0.0, "aerodynamics": 0.0}}


def test_in_the_ideal_case_the_residual_of_the_innocent_suspect_is_no_larger_than_chi_square():
    sim = Simulation(scenario(pair(1), 1.3, parameters=IDEAL), runs=40).advance()
    late = sim["test.ukf.imu.gyro.3.statistic"][-1]
    late = late[np.isfinite(late)]  # now and then noise lets parity space name gyro 1 alone, and nobody asks the UKF
    assert len(late) > 30
    # The filter allows for a model that is wrong; with the right one it is cautious: smaller, never larger.
    assert kstest(late, chi2(2).cdf, alternative="less").pvalue > FALSE_FAILURE
    assert late.max() < chi2.isf(FALSE_FAILURE / 40, 2)


def test_given_a_lead_then_the_ukf_starts_from_states_that_the_fault_has_not_reached():
    """A fault that is declared only four epochs after its onset: what was stored last is contaminated already."""
    error = {}
    for lead in (1, 8):
        late = scenario(pair(1, start=0.9), parameters=IDEAL, lead=lead, driving_test="none")
        sim = Simulation(late, runs=6).advance(until=0.98)
        sim.configure(driving_test="isolation-angle")
        sim.advance(epochs=1)
        episode, truth = sim._state.navigator.episode, sim._state.plant.x[:, 0]
        assert episode.active.all()
        error[lead] = np.abs(episode.x[:, 6] - truth[:, S.Q]).mean()
    assert error[1] > 0.03  # half of the fault's 0.14 rad/s in pitch came in with the stored rates
    assert error[8] < 0.02


def test_the_healthy_axes_only_reach_the_ukf():
    """Whatever the suspects read, the filter that runs without them estimates the same."""
    small, large = Simulation(scenario(pair(1), 1.0)).advance(), Simulation(scenario(pair(1, size=0.2), 1.0)).advance()
    a, b = small._state.navigator.episode, large._state.navigator.episode
    assert a.suspects.tolist() == b.suspects.tolist() == [[True, False, True]]
    np.testing.assert_array_equal(a.x, b.x)
