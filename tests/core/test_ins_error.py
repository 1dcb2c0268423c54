"""The 21-state model against pairs of strapdown runs, the physics of an INS at rest, and noisy strapdown runs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

from ftcore import earth
from ftcore.estimation import ins_error
from ftcore.estimation.ins_error import (
    ACCELEROMETER,
    ALTIMETER_BIAS,
    ALTIMETER_SCALE,
    ATTITUDE,
    CLOCK,
    GYRO,
    POSITION,
    STATE_NAMES,
    VELOCITY,
    NoiseDensities,
    core_matrix,
    correct,
    damping_noise,
    damping_transition,
    navigation_error,
    noise_density,
    process_noise,
    system_matrix,
    transition,
)
from ftcore.estimation.strapdown import InsState, Interval, damp_vertical, damping_gains, propagate
from ftcore.rotation import rpy_to_matrix
from ftcore.world.trajectory import Climb, SpeedChange, Straight, Trajectory, Turn, build

STEP, SAMPLES = 0.025, 40
K1, K2 = damping_gains(30.0)
SIZES = np.concatenate(
    [[1000.0, 1000.0, 100.0], [1.0] * 3, [1e-3] * 3, [1e-5] * 3, [1e-2] * 3, [30.0, 0.01], [0.01, 0.01], [100.0, 10.0]]
)


@pytest.fixture(scope="module")
def manoeuvre() -> Trajectory:
    segments = [
        Turn(angle=60.0, bank=55.0, entry=1.5),
        Climb(height_change=250.0, rate=30.0, entry=2.0),
        SpeedChange(speed=220.0, acceleration=6.0, entry=1.0),
        Turn(angle=-90.0, bank=60.0, entry=1.0),
        Straight(duration=60.0),
    ]
    return build((np.radians(40.0), np.radians(116.0), 5000.0), 260.0, np.radians(60.0), segments, STEP)


def states_at(flight: Trajectory, k: int, runs: int) -> InsState:
    return InsState(*(np.repeat(x[None, k], runs, axis=0) for x in (flight.lla, flight.v_n, flight.C_nb)))


def first_run(x: InsState) -> InsState:
    return InsState(x.lla[:1], x.v_n[:1], x.C_nb[:1])


def first_interval(x: Interval) -> Interval:
    return run_of(x, 0)


def run_of(x: Interval, run: int) -> Interval:
    one = slice(run, run + 1)
    means = (x.lla[one], x.v_n[one], x.f_n[one], x.C_nb[one])
    return Interval(x.duration, *means, x.C_nb_nodes[:, one], x.node_weights)


@pytest.fixture(scope="module", params=[False, True], ids=["free", "damped"])
def responses(request: pytest.FixtureRequest, manoeuvre: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Navigation errors after 60 s, (states, 9): by pairs of strapdown runs, and by the model.

    Each state has two runs, with its error put in positively and negatively; half their difference is the response, to
    second order. Run 0 is without errors and feeds the model.
    """
    n = len(STATE_NAMES)
    put_in = np.concatenate([np.zeros((1, n)), np.diag(SIZES), -np.diag(SIZES)])
    state = correct(states_at(manoeuvre, 0, len(put_in)), -put_in)
    x = np.diag(SIZES)
    for k in range(0, round(60.0 / STEP), SAMPLES):
        omega = manoeuvre.omega_b[None, k : k + SAMPLES] + put_in[:, None, GYRO]
        f = manoeuvre.f_b[None, k : k + SAMPLES] + put_in[:, None, ACCELEROMETER]
        state, interval = propagate(state, omega, f, STEP)
        Phi = transition(system_matrix(first_interval(interval)), interval.duration)[0]
        if request.param:
            height = manoeuvre.lla[k + SAMPLES, 2]
            indicated = height + put_in[:, ALTIMETER_BIAS] + put_in[:, ALTIMETER_SCALE] * height
            Phi = damping_transition(state.lla[0, 2], interval.duration, K1, K2) @ Phi
            state = damp_vertical(state, indicated, interval.duration, K1, K2)
        x = x @ Phi.T
    error = navigation_error(state, first_run(state))
    return (error[1 : n + 1] - error[n + 1 :]) / 2.0, x[:, :9]


@pytest.mark.parametrize("index", range(len(STATE_NAMES)), ids=STATE_NAMES)
def test_given_an_error_in_one_state_when_flown_for_60_s_then_the_model_foretells_the_strapdown_within_2_percent(
    responses: tuple[np.ndarray, np.ndarray], index: int
) -> None:
    """Position, velocity and attitude are each held to 2 % of their own response, however small it is."""
    strapdown, model = (x[index] for x in responses)
    # What differences of positions of 6e6 m, and of the second-order remainder, leave where there is no response.
    floors = (1e-6, 1e-7, 1e-12)
    for part, floor in zip((POSITION, VELOCITY, ATTITUDE), floors, strict=True):
        difference, response = (float(np.linalg.norm(v)) for v in (model[part] - strapdown[part], strapdown[part]))
        assert difference <= 0.02 * response + floor, f"{STATE_NAMES[index]}: {difference} of {response}"


def test_given_a_clock_error_when_time_passes_then_phase_grows_by_frequency_and_touches_nothing_else(
    manoeuvre: Trajectory,
) -> None:
    _, interval = propagate(
        states_at(manoeuvre, 0, 1), manoeuvre.omega_b[None, :SAMPLES], manoeuvre.f_b[None, :SAMPLES], STEP
    )
    Phi = transition(system_matrix(interval), 1.0)[0]
    np.testing.assert_array_equal(Phi[CLOCK, CLOCK], [[1.0, 1.0], [0.0, 1.0]])
    assert not Phi[:19, CLOCK].any()
    assert not Phi[CLOCK, :19].any()
    np.testing.assert_array_equal(Phi[9:19, 9:19], np.eye(10))


@pytest.mark.parametrize("latitude", [15.0, 45.0, -60.0])
def test_given_an_ins_at_rest_when_the_model_is_solved_then_it_swings_with_schuler_foucault_and_the_earth(
    latitude: float,
) -> None:
    lat = np.radians(latitude)
    g = float(earth.gravity(lat, 0.0))
    F = core_matrix(
        np.array([[lat, 0.0, 0.0]]), np.zeros((1, 3)), np.array([[0.0, 0.0, g]]), rpy_to_matrix(np.zeros((1, 3)))
    )[0, :9, :9]
    roots = np.linalg.eigvals(F)

    # The free vertical channel: one root falls away, one diverges.
    vertical = roots[np.abs(roots.real) > 1e-4]
    assert len(vertical) == 2
    np.testing.assert_allclose(np.sort(vertical.real), np.array([-1.0, 1.0]) * np.sqrt(2.0 * g / earth.A), rtol=0.01)
    # All else swings for ever.
    swings = np.sort(np.abs(roots[np.abs(roots.real) <= 1e-4].imag))
    assert np.abs(roots[np.abs(roots.real) <= 1e-4].real).max() < 2e-8
    still, day, schuler = swings[0], swings[1:3], swings[3:]
    assert still < 1e-8
    np.testing.assert_allclose(day, earth.RATE, rtol=0.005)
    assert len(schuler) == 4
    assert 2.0 * np.pi / schuler.mean() / 60.0 == pytest.approx(84.4, rel=0.005)
    # Foucault: the plane of the swing turns with the vertical part of the Earth's rate, and splits the pair in two.
    split = 0.5 * (schuler[2:].mean() - schuler[:2].mean())
    assert split == pytest.approx(earth.RATE * abs(np.sin(lat)), rel=0.05)


def test_given_damping_when_the_model_is_solved_then_the_vertical_channel_dies_away_with_its_time_constant() -> None:
    lat, height = 0.7, 3000.0
    F = np.zeros((1, 21, 21))
    core = np.array([[lat, 0.0, height]]), np.zeros((1, 3)), np.array([[0.0, 0.0, 9.8]]), np.eye(3)[None]
    F[:, :15, :15] = core_matrix(*core)
    D = damping_transition(height, 0.1, K1, K2)
    roots = np.linalg.eigvals((D @ transition(F, 0.1)[0])[np.ix_([2, 5], [2, 5])])
    np.testing.assert_allclose(np.log(np.abs(roots)) / 0.1, -1.0 / 30.0, rtol=0.1)


def test_given_random_errors_when_the_strapdown_is_damped_then_the_matrix_is_exact() -> None:
    rng = np.random.default_rng(1)
    runs = 50
    true = InsState(
        np.tile([0.5, 1.0, 4000.0], (runs, 1)),
        np.tile([100.0, 50.0, -3.0], (runs, 1)),
        rpy_to_matrix(rng.normal(size=(runs, 3))),
    )
    x = rng.normal(size=(runs, 21)) * SIZES
    ins = correct(true, -x)
    indicated = 4000.0 + x[:, ALTIMETER_BIAS] + x[:, ALTIMETER_SCALE] * 4000.0
    damped = damp_vertical(ins, indicated, 0.5, 0.3, 0.04)
    D = damping_transition(np.full(runs, 4000.0), 0.5, 0.3, 0.04)
    expected = (D @ x[..., None])[..., 0]
    np.testing.assert_allclose((damped.lla - true.lla)[:, 2], expected[:, 2], rtol=0, atol=1e-9)
    np.testing.assert_allclose((damped.v_n - true.v_n)[:, 2], expected[:, 5], rtol=0, atol=1e-11)
    np.testing.assert_array_equal(np.delete(expected, [2, 5], axis=1), np.delete(x, [2, 5], axis=1))


def test_given_altimeter_noise_when_an_epoch_is_damped_then_its_covariance_is_that_of_gain_times_noise() -> None:
    Q = damping_noise(2.0, np.array([0.1, 0.0]), 0.01, 5.0)
    d = np.zeros((2, 21))
    d[:, 2], d[:, 5] = [1.0, 0.0], [0.1, 0.1]
    np.testing.assert_allclose(Q, np.einsum("ri,rj->rij", d, d))


def test_given_any_errors_when_put_in_and_taken_out_then_the_state_is_the_same() -> None:
    rng = np.random.default_rng(2)
    lla = np.stack([rng.uniform(-1.4, 1.4, 20), rng.uniform(-3.1, 3.1, 20), rng.uniform(-100, 2e4, 20)], axis=-1)
    ins = InsState(lla, 100.0 * rng.normal(size=(20, 3)), rpy_to_matrix(rng.normal(size=(20, 3))))
    x = rng.normal(size=(20, 21)) * SIZES
    corrected = correct(ins, x)
    np.testing.assert_allclose(navigation_error(ins, corrected), x[:, :9], rtol=1e-9, atol=1e-8)
    # And the sign is indicated - true: a positive error makes the corrected height lower.
    np.testing.assert_allclose(ins.lla[:, 2] - corrected.lla[:, 2], x[:, 2], atol=1e-8)


def test_given_an_azimuth_error_when_positive_then_the_indicated_heading_is_too_small() -> None:
    true = InsState(np.zeros((1, 3)), np.zeros((1, 3)), rpy_to_matrix(np.array([[0.0, 0.0, 1.0]])))
    x = np.zeros((1, 9))
    x[0, 8] = 0.01
    indicated = correct(true, -x)
    np.testing.assert_allclose(indicated.C_nb[0], rpy_to_matrix(np.array([0.0, 0.0, 0.99])), atol=1e-15)


def flown(flight: Trajectory) -> Interval:
    return propagate(states_at(flight, 1200, 1), flight.omega_b[None, 1200:1240], flight.f_b[None, 1200:1240], STEP)[1]


def test_given_a_system_matrix_when_exponentiated_then_scipy_agrees_to_third_order(manoeuvre: Trajectory) -> None:
    F = system_matrix(flown(manoeuvre))
    # The fourth-order term is gyro drift to position by way of the Earth's and the level's rate: 20 x 2e-4 / 24.
    np.testing.assert_allclose(transition(F, 1.0)[0], expm(F[0]), rtol=0, atol=2e-4)
    np.testing.assert_allclose(transition(F, 0.1)[0], expm(0.1 * F[0]), rtol=0, atol=2e-8)
    for kernel in (transition, lambda A, dt: process_noise(A, np.eye(21), dt)):
        many = kernel(np.repeat(F, 37, axis=0) * np.linspace(0.5, 1.0, 37)[:, None, None], 1.0)
        np.testing.assert_allclose(many[36], kernel(F, 1.0)[0], rtol=0, atol=1e-15)
        np.testing.assert_allclose(many[0], kernel(F * 0.5, 1.0)[0], rtol=0, atol=1e-15)


DENSITIES = NoiseDensities(
    gyro=(np.radians(0.01) / 60.0) ** 2,
    accelerometer=(10e-6 * earth.STANDARD_GRAVITY) ** 2,
    clock_phase=0.036,
    clock_frequency=0.141,
    gyro_walk=1e-16,
    altimeter_bias_walk=0.01,
)


def test_given_the_two_state_clock_when_noise_is_integrated_then_it_is_the_closed_form(manoeuvre: Trajectory) -> None:
    interval = flown(manoeuvre)
    for t in (0.1, 1.0, 10.0):
        Q = process_noise(system_matrix(interval), noise_density(interval, DENSITIES), t)[0, CLOCK, CLOCK]
        s_f, s_g = 0.036, 0.141
        np.testing.assert_allclose(
            Q, [[s_f * t + s_g * t**3 / 3.0, s_g * t**2 / 2.0], [s_g * t**2 / 2.0, s_g * t]], rtol=1e-13
        )


def test_given_one_long_step_when_noise_is_integrated_then_two_half_steps_give_the_same(manoeuvre: Trajectory) -> None:
    interval = flown(manoeuvre)
    F, Qc = system_matrix(interval), noise_density(interval, DENSITIES)
    half, Phi = process_noise(F, Qc, 0.5), transition(F, 0.5)
    twice = Phi @ half @ Phi[0].T + half
    whole = process_noise(F, Qc, 1.0)
    sigma = np.sqrt(np.diagonal(whole[0]))
    scale = np.where(sigma > 0.0, sigma, 1.0)
    np.testing.assert_allclose(whole[0] / np.outer(scale, scale), twice[0] / np.outer(scale, scale), rtol=0, atol=1e-3)
    assert np.linalg.eigvalsh(whole[0] / np.outer(scale, scale)).min() > -1e-12


def test_given_densities_per_axis_and_per_run_when_made_a_matrix_then_each_is_turned_to_level() -> None:
    C_nb = rpy_to_matrix(np.array([[0.3, -0.2, 1.0], [0.0, 0.0, 0.0]]))
    gyro = np.diag([1.0, 2.0, 3.0])
    densities = NoiseDensities(gyro=gyro, accelerometer=np.array([4.0, 5.0]), clock_phase=np.array([6, 7]))
    Qc = noise_density(C_nb, densities)
    np.testing.assert_allclose(Qc[:, ATTITUDE, ATTITUDE], C_nb @ gyro @ np.swapaxes(C_nb, -1, -2))
    np.testing.assert_allclose(Qc[:, VELOCITY, VELOCITY], np.array([4.0, 5.0])[:, None, None] * np.eye(3))
    np.testing.assert_allclose(Qc[:, 19, 19], [6.0, 7.0])


def test_given_noisy_imus_when_flown_then_their_errors_have_the_covariance_of_the_model(manoeuvre: Trajectory) -> None:
    """400 runs of 20 s, gyros noisier about one body axis. The normalised squared error summed over runs is chi-square.

    Ten bands with 1e-5 on each side: a false failure once in 5000 seeds, and the seed is fixed.
    """
    runs, seconds = 400, 20
    rng = np.random.default_rng(7)
    gyro = np.diag([1.0, 1.0, 25.0]) * 1e-10
    accelerometer = np.diag([1.0, 9.0, 1.0]) * 1e-6
    densities = NoiseDensities(gyro=gyro, accelerometer=accelerometer)
    sigma_baro, k1, k2 = 2.0, 0.1, 0.005
    state, P = states_at(manoeuvre, 0, runs), np.zeros((21, 21))
    clean = first_run(state)
    for k in range(0, seconds * SAMPLES, SAMPLES):
        noise = rng.normal(size=(2, runs, SAMPLES, 3)) / np.sqrt(STEP)
        omega, f = manoeuvre.omega_b[None, k : k + SAMPLES], manoeuvre.f_b[None, k : k + SAMPLES]
        state, _ = propagate(
            state, omega + noise[0] * np.sqrt(np.diag(gyro)), f + noise[1] * np.sqrt(np.diag(accelerometer)), STEP
        )
        clean, interval = propagate(clean, omega, f, STEP)
        height = manoeuvre.lla[k + SAMPLES, 2]
        state = damp_vertical(state, height + sigma_baro * rng.normal(size=runs), 1.0, k1, k2)
        clean = damp_vertical(clean, height, 1.0, k1, k2)
        F = system_matrix(interval)
        D, Phi = damping_transition(height, 1.0, k1, k2), transition(F, 1.0)[0]
        Q = process_noise(F, noise_density(interval, densities), 1.0)[0]
        P = D @ (Phi @ P @ Phi.T + Q) @ D.T + damping_noise(1.0, k1, k2, sigma_baro)
    error = navigation_error(state, clean)
    normalised = np.linalg.solve(np.linalg.cholesky(P[:9, :9]), error.T)
    print("variance of each whitened component:", np.round((normalised**2).mean(axis=1), 3))
    for total, dof in [((normalised**2).sum(), 9 * runs), *((row @ row, runs) for row in normalised)]:
        assert chi2.ppf(1e-5, dof) < total < chi2.isf(1e-5, dof)


def test_given_an_interval_of_many_runs_when_made_matrices_then_each_is_its_own_run(manoeuvre: Trajectory) -> None:
    rng = np.random.default_rng(5)
    omega = manoeuvre.omega_b[None, :SAMPLES] + 0.1 * rng.normal(size=(3, SAMPLES, 3))
    f = manoeuvre.f_b[None, :SAMPLES] + rng.normal(size=(3, SAMPLES, 3))
    _, interval = propagate(states_at(manoeuvre, 0, 3), omega, f, STEP)
    F = system_matrix(interval)
    assert F.shape == (3, 21, 21)
    for run in range(3):
        np.testing.assert_allclose(system_matrix(run_of(interval, run))[0], F[run], rtol=1e-12, atol=1e-18)


def test_given_the_names_when_counted_then_they_fit_the_slices() -> None:
    assert len(STATE_NAMES) == ins_error.STATES == 21
    for part, prefix in ((POSITION, "position"), (VELOCITY, "velocity"), (ATTITUDE, "attitude"), (GYRO, "gyro")):
        assert all(name.startswith(prefix) for name in STATE_NAMES[part])
    assert STATE_NAMES[ins_error.DOPPLER_SCALE] == "doppler.scale"
    assert STATE_NAMES[ins_error.CLOCK_FREQUENCY] == "clock.frequency"
