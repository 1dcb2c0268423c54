"""Strapdown navigation against pyins, closed forms of coning and sculling, and the physics of an INS at rest."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pyins.earth
import pyins.strapdown
import pytest

from ftcore import earth
from ftcore.estimation.ins_error import correct, navigation_error
from ftcore.estimation.strapdown import InsState, damp_vertical, damping_gains, propagate
from ftcore.rotation import matrix_to_rotvec, matrix_to_rpy, rotvec_to_matrix, rpy_to_matrix
from ftcore.world.trajectory import Climb, SpeedChange, Straight, Trajectory, Turn, build

START = (np.radians(40.0), np.radians(116.0), 5000.0)


def state_at(flight: Trajectory, k: int) -> InsState:
    return InsState(flight.lla[None, k], flight.v_n[None, k], flight.C_nb[None, k])


def at_rest(runs: int = 1, lat: float = 0.7, height: float = 0.0, heading: float = 0.0) -> InsState:
    return InsState(
        np.tile([lat, 0.3, height], (runs, 1)),
        np.zeros((runs, 3)),
        np.tile(rpy_to_matrix(np.array([0.0, 0.0, heading])), (runs, 1, 1)),
    )


def rest_signal(state: InsState, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """What a perfect IMU at rest reads in the attitude of ``state``."""
    up = np.array([0.0, 0.0, earth.gravity(state.lla[0, 0], state.lla[0, 2])])
    omega = earth.earth_rate_n(state.lla[0, 0]) @ state.C_nb[0]
    return np.tile(omega, (1, samples, 1)), np.tile(up @ state.C_nb[0], (1, samples, 1))


@pytest.fixture(scope="module")
def manoeuvre() -> Trajectory:
    segments = [
        Turn(angle=60.0, bank=50.0, entry=1.5),
        Climb(height_change=200.0, rate=30.0, entry=2.0),
        SpeedChange(speed=220.0, acceleration=6.0, entry=1.0),
        Turn(angle=-90.0, bank=60.0, entry=1.0),
        Straight(duration=60.0),
    ]
    return build(START, 260.0, 1.0, segments, 0.025)


def test_given_the_same_samples_when_pyins_integrates_them_then_both_end_at_the_same_place(
    manoeuvre: Trajectory,
) -> None:
    seconds, dt = 60, manoeuvre.dt
    count = round(seconds / dt)
    # pyins has gravity fall off linearly with height: give it the difference as specific force, up the true attitude.
    lat, height = manoeuvre.lla[:, 0], manoeuvre.lla[:, 2]
    excess = pyins.earth.gravity(np.degrees(lat), height) - earth.gravity(lat, height)
    up_b = 0.5 * (manoeuvre.C_nb[1:, 2] + manoeuvre.C_nb[:-1, 2])
    f_b = manoeuvre.f_b + (0.5 * (excess[1:] + excess[:-1]))[:, None] * up_b

    rows = np.concatenate([manoeuvre.omega_b[:1], manoeuvre.omega_b[:count]]) * dt
    forces = np.concatenate([f_b[:1], f_b[:count]]) * dt
    imu = pd.DataFrame(
        np.hstack([rows, forces]),
        index=np.arange(count + 1) * dt,
        columns=["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"],
    )
    v, rpy, lla = manoeuvre.v_n[0], np.degrees(manoeuvre.rpy[0]), manoeuvre.lla[0]
    pva = pd.Series(
        [*np.degrees(lla[:2]), lla[2], v[1], v[0], -v[2], *rpy],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
    )
    integrator = pyins.strapdown.Integrator(pva)
    integrator.integrate(pyins.strapdown.compute_increments_from_imu(imu, "increment"))
    p = integrator.get_pva()
    theirs = InsState(
        np.array([[np.radians(p.lat), np.radians(p.lon), p.alt]]),
        np.array([[p.VE, p.VN, -p.VD]]),
        rpy_to_matrix(np.radians([[p.roll, p.pitch, p.heading]])),
    )
    ours = state_at(manoeuvre, 0)
    for k in range(0, count, 40):
        ours, _ = propagate(ours, manoeuvre.omega_b[None, k : k + 40], manoeuvre.f_b[None, k : k + 40], dt)
    difference = navigation_error(ours, theirs)[0]
    print("ours - pyins:", difference)
    # pyins compensates one order lower; its own distance to the truth here is what the limits allow for.
    assert np.abs(difference[:3]).max() < 0.2
    assert np.abs(difference[3:6]).max() < 5e-3
    assert np.abs(difference[6:]).max() < 5e-6
    error = navigation_error(ours, state_at(manoeuvre, count))[0]
    assert np.abs(error[:3]).max() < 5e-3


@pytest.mark.parametrize("samples", [2, 5, 10, 40])
def test_given_a_coning_motion_when_integrated_then_all_but_thousandths_of_the_drift_are_compensated(
    samples: int,
) -> None:
    """Body z wanders around a cone of half angle a: omega = (-W sin a sin Wt, W sin a cos Wt, -2 W sin^2(a/2))."""
    a, W, dt, seconds = np.radians(1.0), 2.0 * np.pi * 2.0, 0.025, 20
    state0 = at_rest()
    cone0 = rotvec_to_matrix(np.array([a, 0.0, 0.0]))
    edges = np.arange(round(seconds / dt) + 1) * dt
    # Exact means over each sample; rest's own rate and force seen from the wandering axes, at its middle.
    mean_sin = -np.diff(np.cos(W * edges)) / (W * dt)
    mean_cos = np.diff(np.sin(W * edges)) / (W * dt)
    omega = np.stack(
        [-W * np.sin(a) * mean_sin, W * np.sin(a) * mean_cos, np.full(len(mean_sin), -2 * W * np.sin(a / 2) ** 2)], -1
    )
    middle = W * 0.5 * (edges[1:] + edges[:-1])
    wander = rotvec_to_matrix(a * np.stack([np.cos(middle), np.sin(middle), np.zeros_like(middle)], axis=-1))
    rest_omega, rest_f = rest_signal(state0, 1)
    omega = omega + rest_omega[0, 0] @ wander
    f = rest_f[0, 0] @ wander
    state = InsState(state0.lla, state0.v_n, state0.C_nb @ cone0)
    for k in range(0, len(f), samples):
        state, _ = propagate(state, omega[None, k : k + samples], f[None, k : k + samples], dt)
    turned = matrix_to_rotvec(np.swapaxes(state0.C_nb, -1, -2) @ state.C_nb @ cone0.T)[0]
    # Without compensation the cone's axis drifts at W a^2 / 2 times the part of a turn a sample hides.
    uncompensated = W * (1 - np.cos(a)) * (1 - np.sinc(W * dt / np.pi)) * seconds
    print(f"{samples} samples: drift {turned}, uncompensated {uncompensated:.2e}")
    assert uncompensated > 2e-4
    assert abs(turned[2]) < uncompensated * (0.003 if samples >= 5 else 0.2)


def test_given_a_rocking_motion_with_a_pulsing_force_when_integrated_then_the_velocity_is_right() -> None:
    """Classical sculling: roll p0 sin Wt while the y axis accelerates with cos Wt; oracle: dense quadrature."""
    p0, W, A, dt, seconds = np.radians(2.0), 2.0 * np.pi * 2.0, 5.0, 0.025, 10
    state0 = at_rest(lat=0.0)
    fine = 400
    count = round(seconds / dt)
    t = (np.arange(count * fine) + 0.5) * (dt / fine)
    roll = p0 * np.sin(W * t)
    g = float(earth.gravity(0.0, 0.0))
    s, c = np.sin(roll), np.cos(roll)
    # In axes forward (north), right (east), down: rolling turns right into down. Earth rate is along the roll axis.
    push = A * np.sin(W * t)
    f_b = np.stack([np.zeros_like(t), push - g * s, -g * c], axis=-1)
    f_n = np.stack([push * c, np.zeros_like(t), -push * s], axis=-1)
    omega_x = np.diff(p0 * np.sin(W * np.arange(count + 1) * dt)) / dt + earth.RATE
    omega = np.stack([omega_x, np.zeros(count), np.zeros(count)], axis=-1)
    f = f_b.reshape(count, fine, 3).mean(axis=1)
    state = state0
    for k in range(0, count, 40):
        state, _ = propagate(state, omega[None, k : k + 40], f[None, k : k + 40], dt)
    expected = f_n.sum(axis=0) * (dt / fine)
    rectified = abs(expected[2])
    assert rectified > 0.5
    # Coriolis of the acquired velocities (2 m/s) is left in: 1.5e-4 x 2 x 10.
    np.testing.assert_allclose(state.v_n[0, 2], expected[2], rtol=0, atol=rectified * 1e-3 + 3e-3)


def test_given_a_perfect_imu_at_rest_when_integrated_for_an_hour_with_a_held_height_then_nothing_moves() -> None:
    state0 = at_rest(heading=0.4)
    omega, f = rest_signal(state0, 2)
    state = state0
    for _ in range(3600):
        state, _ = propagate(state, omega, f, 0.5)
        state = damp_vertical(state, state0.lla[:, 2], 1.0, 0.2, 0.02)
    error = navigation_error(state, state0)[0]
    assert np.abs(error[:3]).max() < 2e-3
    assert np.abs(error[3:6]).max() < 2e-6
    assert np.abs(error[6:]).max() < 1e-9


def test_given_an_initial_tilt_at_rest_when_integrated_then_velocity_swings_with_the_schuler_period() -> None:
    """About the north axis at the equator: there the Earth's rate does not mix the east channel with the north one."""
    state0 = at_rest(lat=0.0)
    omega, f = rest_signal(state0, 2)
    tilt = np.zeros((1, 9))
    tilt[0, 7] = -1e-4
    state = correct(state0, tilt)
    velocity = []
    for _ in range(6000):
        state, _ = propagate(state, omega, f, 0.5)
        state = damp_vertical(state, state0.lla[:, 2], 1.0, 0.2, 0.02)
        velocity.append(state.v_n[0, 0])
    velocity = np.array(velocity)
    _, r_n = earth.principal_radii(0.0)
    g = earth.gravity(0.0, 0.0)
    np.testing.assert_allclose(np.abs(velocity).max(), 1e-4 * np.sqrt(g * r_n), rtol=1e-3)
    crossing = np.nonzero(np.diff(np.sign(velocity)))[0]
    assert 2.0 * crossing[0] == pytest.approx(2.0 * np.pi * np.sqrt(r_n / g), rel=2e-3)
    assert 2.0 * crossing[0] / 60.0 == pytest.approx(84.4, abs=0.2)


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 5, 6, 7, 13, 20])
def test_given_any_number_of_samples_a_call_when_integrated_then_the_end_is_the_same(
    manoeuvre: Trajectory, samples: int
) -> None:
    """Short calls know less of a sample's neighbours; one sample a call is the crudest."""
    dt, count = manoeuvre.dt, 13 * 20 * 7 // 2 * 2 // 2
    state = state_at(manoeuvre, 0)
    for k in range(0, count, samples):
        n = min(samples, count - k)
        state, _ = propagate(state, manoeuvre.omega_b[None, k : k + n], manoeuvre.f_b[None, k : k + n], dt)
    error = navigation_error(state, state_at(manoeuvre, count))[0]
    assert np.abs(error[:3]).max() < (1e-3 if samples >= 5 else 0.2)


def test_given_a_batch_when_one_run_is_integrated_alone_then_it_is_the_same_to_rounding(manoeuvre: Trajectory) -> None:
    rng = np.random.default_rng(3)
    runs, dt = 23, manoeuvre.dt
    omega = manoeuvre.omega_b[None, :400] + 0.01 * rng.normal(size=(runs, 400, 3))
    f = manoeuvre.f_b[None, :400] + 0.1 * rng.normal(size=(runs, 400, 3))
    together, alone = state_at(manoeuvre, 0), state_at(manoeuvre, 0)
    for k in range(0, 400, 40):
        together, _ = propagate(together, omega[:, k : k + 40], f[:, k : k + 40], dt)
        alone, _ = propagate(alone, omega[17:18, k : k + 40], f[17:18, k : k + 40], dt)
    np.testing.assert_allclose(alone.lla[0], together.lla[17], rtol=1e-12)
    np.testing.assert_allclose(alone.v_n[0], together.v_n[17], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(alone.C_nb[0], together.C_nb[17], rtol=0, atol=1e-12)


def test_given_an_interval_when_summed_up_then_its_means_are_those_of_the_truth(manoeuvre: Trajectory) -> None:
    k, n = 80, 40
    window = slice(k, k + n + 1)
    weights = np.full(n + 1, 1.0 / n)
    weights[[0, -1]] *= 0.5
    omega, f = manoeuvre.omega_b[None, k : k + n], manoeuvre.f_b[None, k : k + n]
    _, interval = propagate(state_at(manoeuvre, k), omega, f, manoeuvre.dt)
    C = manoeuvre.C_nb[window]
    f_n = np.einsum("nij,nj->i", 0.5 * (C[1:] + C[:-1]), manoeuvre.f_b[k : k + n]) / n
    assert interval.duration == 1.0
    np.testing.assert_allclose(interval.f_n[0], f_n, rtol=0, atol=2e-3)
    np.testing.assert_allclose(interval.v_n[0], weights @ manoeuvre.v_n[window], rtol=0, atol=2e-3)
    np.testing.assert_allclose(interval.C_nb[0], np.einsum("n,nij->ij", weights, C), rtol=0, atol=2e-3)
    np.testing.assert_allclose(interval.lla[0], manoeuvre.lla[k + n // 2], rtol=0, atol=1.0)
    np.testing.assert_allclose(interval.lla[0, :2], manoeuvre.lla[k + n // 2, :2], rtol=0, atol=1e-6)


def test_given_a_state_when_integrated_or_damped_then_the_old_one_is_untouched(manoeuvre: Trajectory) -> None:
    """The trajectory's arrays are read-only: a write into them would raise."""
    state = state_at(manoeuvre, 0)
    new, _ = propagate(state, manoeuvre.omega_b[None, :40], manoeuvre.f_b[None, :40], 0.025)
    kept = new.lla.copy(), new.v_n.copy(), new.C_nb.copy()
    damp_vertical(new, np.array([0.0]), 1.0, 0.1, 0.01)
    propagate(new, manoeuvre.omega_b[None, 40:80], manoeuvre.f_b[None, 40:80], 0.025)
    for old, now in zip(kept, (new.lla, new.v_n, new.C_nb), strict=True):
        np.testing.assert_array_equal(old, now)


def test_given_an_eastward_flight_over_the_date_line_when_integrated_then_longitude_wraps() -> None:
    flight = build((0.5, np.pi - 2e-5, 3000.0), 250.0, np.pi / 2, [Straight(duration=4.0)], 0.025)
    state = state_at(flight, 0)
    for k in range(0, 160, 40):
        state, _ = propagate(state, flight.omega_b[None, k : k + 40], flight.f_b[None, k : k + 40], 0.025)
    assert -np.pi <= state.lla[0, 1] < 0.0
    assert np.abs(navigation_error(state, state_at(flight, 160))[0, :3]).max() < 1e-3


@pytest.mark.parametrize("reading", [np.inf, np.nan, 1e200])
def test_given_an_absurd_reading_when_integrated_then_other_runs_do_not_care_and_nothing_raises(reading: float) -> None:
    omega, f = rest_signal(at_rest(), 40)
    broken = f.copy()
    broken[0, 7, 1] = reading
    with np.errstate(all="ignore"):
        propagate(at_rest(), omega, broken, 0.025)
        both, _ = propagate(at_rest(2), omega, np.concatenate([broken, f]), 0.025)
    alone, _ = propagate(at_rest(), omega, f, 0.025)
    np.testing.assert_allclose(both.v_n[1], alone.v_n[0], rtol=0, atol=1e-12)


def test_given_samples_of_the_wrong_shape_when_integrated_then_the_message_says_so() -> None:
    state = at_rest()
    with pytest.raises(ValueError, match=r"\(runs, N, 3\).*\(40, 3\)"):
        propagate(state, np.zeros((40, 3)), np.zeros((40, 3)), 0.025)
    with pytest.raises(ValueError, match="N >= 1"):
        propagate(state, np.zeros((1, 0, 3)), np.zeros((1, 0, 3)), 0.025)
    with pytest.raises(ValueError, match="dt must be positive"):
        propagate(state, np.zeros((1, 4, 3)), np.zeros((1, 4, 3)), 0.0)


def test_given_the_default_gains_when_height_starts_wrong_then_it_comes_back_without_overshoot() -> None:
    k1, k2 = damping_gains(30.0)
    state0 = at_rest()
    omega, f = rest_signal(state0, 2)
    state = InsState(state0.lla + np.array([0.0, 0.0, 100.0]), state0.v_n, state0.C_nb)
    heights = []
    for _ in range(300):
        state, _ = propagate(state, omega, f, 0.5)
        state = damp_vertical(state, np.zeros(1), 1.0, k1, k2)
        heights.append(state.lla[0, 2])
    heights = np.array(heights)
    # Critically damped with both poles at 1/T, from rest: 100 (1 - t/T) exp(-t/T), so one dip of 100 exp(-2).
    t = np.arange(1, 301)
    np.testing.assert_allclose(heights, 100.0 * (1.0 - t / 30.0) * np.exp(-t / 30.0), rtol=0, atol=3.0)
    assert abs(heights[-1]) < 0.1
    with pytest.raises(ValueError, match="time constant"):
        damping_gains(0.0)


def test_given_gains_per_run_when_damped_then_only_runs_with_an_altimeter_move() -> None:
    state = at_rest(2, height=10.0)
    damped = damp_vertical(state, np.array([0.0, np.float64(0.0)]), 1.0, np.array([0.5, 0.0]), np.array([0.1, 0.0]))
    np.testing.assert_allclose(damped.lla[:, 2], [5.0, 10.0])
    np.testing.assert_allclose(damped.v_n[:, 2], [-1.0, 0.0])


def test_given_the_attitude_of_truth_when_read_as_angles_then_it_is_the_truths(manoeuvre: Trajectory) -> None:
    np.testing.assert_allclose(matrix_to_rpy(manoeuvre.C_nb), manoeuvre.rpy, rtol=0, atol=1e-12)
