"""The F-16: the source's printed check case and trims, physics that must hold, and the batch against a plain scalar."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import approx_fprime

from ftcore.world.aircraft import (
    FOOT,
    GRAVITY,
    REGULATED,
    C,
    S,
    derivative,
    f16,
    linearise,
    lqr,
    midpoint_step,
    regulator,
    step,
    trim,
)
from ftcore.world.aircraft.dynamics import (
    CONTROL_MAX,
    CONTROL_MIN,
    WING_AREA,
    aerodynamics,
    atmosphere,
    power_command,
    power_rate,
)
from ftcore.world.aircraft.tables import published

F16 = f16()
FEET = [S.SPEED, S.EAST, S.NORTH, S.UP]
ORDER = [
    "VT_ft_s",
    "alpha",
    "beta",
    "phi",
    "theta",
    "psi",
    "P",
    "Q",
    "R",
    "east_ft",
    "north_ft",
    "altitude_ft",
    "power",
]


def some_flight(rng, shape=(), calm=False):
    """States and controls all over the envelope; calm: no sideslip, no bank, no roll or yaw, rudder and aileron 0."""
    low = [80.0, -0.15, -0.5, -1.5, -1.2, -3.0, -1.0, -0.6, -0.5, -1e4, -1e4, 0.0, 0.0]
    high = [300.0, 0.75, 0.5, 1.5, 1.2, 3.0, 1.0, 0.6, 0.5, 1e4, 1e4, 12000.0, 100.0]
    x = rng.uniform(low, high, (*shape, 13))
    u = rng.uniform(CONTROL_MIN, CONTROL_MAX, (*shape, 4))
    if calm:
        x[..., [S.BETA, S.ROLL, S.P, S.R]] = 0.0
        u[..., [C.AILERON, C.RUDDER]] = 0.0
    return x, u


# ---- printed numbers


def test_the_printed_check_case_of_the_source():
    case = published()["check_case"]
    x = np.array([case["state"][name] for name in ORDER], dtype=float)
    x[FEET] *= FOOT
    u = np.array([case["controls"]["throttle"], *np.deg2rad(list(case["controls"].values())[1:])])
    rates = derivative(f16(case["xcg"]), x, u)
    rates[FEET] /= FOOT
    np.testing.assert_allclose(rates, [case["rates"][name] for name in ORDER], rtol=2.5e-4)


@pytest.mark.parametrize(
    ("xcg", "throttle", "elevator", "alpha"),
    [
        (0.35, "0.1385", "-0.7588", "0.03691"),
        (0.30, "0.1485", "-1.931", "0.03936"),
        (0.38, "0.1325", "-0.0559", "0.03544"),
    ],
)
def test_trims_at_502_feet_per_second_and_sea_level_to_the_printed_digits(xcg, throttle, elevator, alpha):
    found = trim(f16(xcg), 502.0 * FOOT, 0.0)
    for printed, value in (
        (throttle, found.u[C.THROTTLE]),
        (elevator, np.rad2deg(found.u[C.ELEVATOR])),
        (alpha, found.x[S.ALPHA]),
        (alpha, found.x[S.PITCH]),
    ):
        digits = len(printed.split(".")[1])
        assert f"{value:.{digits}f}" == printed
    np.testing.assert_allclose([*found.u[2:], found.x[S.BETA], found.turn_rate], 0.0, atol=1e-12)


def test_printed_trim_in_a_steep_turn():
    found = trim(f16(0.3), 502.0 * FOOT, 0.0, bank=1.367)
    np.testing.assert_allclose(found.turn_rate, 0.3, rtol=2e-3)
    np.testing.assert_allclose(np.rad2deg(found.u[1:]), [-6.256, 0.09891, -0.4218], rtol=2e-3)
    np.testing.assert_allclose(found.x[[S.ALPHA, S.BETA, S.Q, S.R]], [0.2485, 4.8e-4, 0.2934, 0.06071], rtol=2e-3)


# ---- trims


@pytest.mark.parametrize(("climb", "bank"), [(0.0, 0.0), (36.6, 0.0), (-5.0, 0.5), (36.6, 0.8)])
def test_a_trimmed_flight_stays_as_it_is(climb, bank):
    found = trim(F16, 153.0, 1000.0, climb, bank)
    dx = derivative(F16, found.x, found.u)
    np.testing.assert_allclose(dx[[S.SPEED, S.ALPHA, S.BETA, S.ROLL, S.PITCH, S.P, S.Q, S.R, S.POWER]], 0.0, atol=1e-8)
    assert dx[S.UP] == pytest.approx(climb)
    assert dx[S.HEADING] == pytest.approx(found.turn_rate)
    assert found.turn_rate == pytest.approx(GRAVITY * math.tan(bank) / 153.0, rel=0.1)
    x = found.x
    for _ in range(50):
        x = step(F16, x, found.u, 0.02)
    moved = [S.SPEED, S.ALPHA, S.BETA, S.ROLL, S.PITCH, S.P, S.Q, S.R]
    np.testing.assert_allclose(x[moved], found.x[moved], rtol=5e-3, atol=1e-3)


@pytest.mark.parametrize(
    "wish", [{"speed": -1.0}, {"speed": 36.6}, {"bank": 1.5}, {"climb_rate": 200.0}, {"bank": 1.6}]
)
def test_a_flight_that_cannot_be_is_refused(wish):
    with pytest.raises(ValueError, match="no steady flight"):
        trim(F16, **{"speed": 153.0, "height": 0.0, **wish})


# ---- symmetry, energy, momentum


def test_mirrored_flight_is_mirrored():
    rng = np.random.default_rng(3)
    x, u = some_flight(rng, (200,))
    u[..., [C.AILERON, C.RUDDER]] = 0.0  # the tables of the controls are not symmetric: the wind tunnel's asymmetry
    quiet = replace(F16, engine_momentum=0.0)
    odd = [S.BETA, S.ROLL, S.HEADING, S.P, S.R, S.EAST]
    sign = np.ones(13)
    sign[odd] = -1.0
    np.testing.assert_allclose(derivative(quiet, sign * x, u), sign * derivative(quiet, x, u), rtol=1e-9, atol=1e-9)


def test_flight_without_bank_and_sideslip_stays_in_its_plane():
    x, u = some_flight(np.random.default_rng(4), (100,), calm=True)
    dx = derivative(replace(F16, engine_momentum=0.0), x, u)
    np.testing.assert_allclose(dx[:, [S.BETA, S.ROLL, S.HEADING, S.P, S.R]], 0.0, atol=1e-12)


def test_energy_changes_by_the_power_of_the_forces():
    x, u = some_flight(np.random.default_rng(5), (300,))
    dx = derivative(F16, x, u)
    V, alpha, beta = x[:, 0], x[:, 1], x[:, 2]
    coefficients, thrust = aerodynamics(F16, x, u)
    force = 0.5 * atmosphere(x[:, S.UP])[0] * V**2 * WING_AREA * coefficients.T[:3]
    force[0] += thrust
    velocity = V * np.stack([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    power = (force * velocity).sum(axis=0)
    np.testing.assert_allclose(F16.mass * (V * dx[:, S.SPEED] + GRAVITY * dx[:, S.UP]), power, rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(dx[:, [S.EAST, S.NORTH, S.UP]], axis=1), V, rtol=1e-12)


def test_without_engine_and_controls_drag_takes_energy():
    glide = trim(F16, 160.0, 3000.0)
    x = glide.x.copy()
    x[S.POWER] = 0.0
    dx = derivative(F16, x, np.array([0.0, *glide.u[1:]]))
    assert x[S.SPEED] * dx[S.SPEED] + GRAVITY * dx[S.UP] < 0.0


def test_without_air_angular_momentum_stays_in_space():
    free = replace(F16, force_factor=0.0, moment_factor=0.0)
    Jx, Jy, Jz, Jxz = free.inertia
    J = np.array([[Jx, 0, -Jxz], [0, Jy, 0], [-Jxz, 0, Jz]])
    x, u = some_flight(np.random.default_rng(6), (20,))
    x[:, S.PITCH] *= 0.3

    def momentum(x):
        return np.linalg.norm(x[:, 6:9] @ J + [free.engine_momentum, 0.0, 0.0], axis=1)

    before = momentum(x)
    for _ in range(100):
        x = step(free, x, u, 0.01)
    np.testing.assert_allclose(momentum(x), before, rtol=1e-8)


# ---- vectorised = scalar


def scalar(aircraft, x, u):
    """The equations of motion once more, in plain numbers and feet, with a look-up written the other way round."""
    data, t = published(), published()["tables"]
    V, al, be, ph, th, ps, p, q, r, _, _, up, power = (float(v) for v in x)
    thr, el, ail, rud = (float(min(max(v, a), b)) for v, a, b in zip(u, CONTROL_MIN, CONTROL_MAX, strict=True))

    def line(axis, value):
        i = 0
        while i < len(axis) - 2 and value >= axis[i + 1]:
            i += 1
        return i, (value - axis[i]) / (axis[i + 1] - axis[i])

    def one(name):
        i, f = line(t[name]["axes"][0][1], math.degrees(al))
        v = t[name]["values"]
        return (1 - f) * v[i] + f * v[i + 1]

    def two(name, a, b):
        (i, f), (j, g) = line(t[name]["axes"][0][1], a), line(t[name]["axes"][1][1], b)
        v = t[name]["values"]
        return (1 - f) * ((1 - g) * v[i][j] + g * v[i][j + 1]) + f * ((1 - g) * v[i + 1][j] + g * v[i + 1][j + 1])

    vt, h, A, B = V / 0.3048, up / 0.3048, math.degrees(al), math.degrees(be)
    E, D, R = math.degrees(el), math.degrees(ail) / 20, math.degrees(rud) / 30
    tf = 1 - 0.703e-5 * h
    rho, T = 0.002377 * tf**4.14, (390.0 if h >= 35000 else 519.0 * tf)
    mach, qS = vt / math.sqrt(1.4 * 1716.3 * T), 0.5 * rho * vt * vt * 300.0
    idle, mil, top = (two(f"thrust_{n}_lbf", mach, h) for n in ("idle", "military", "maximum"))
    push = idle + (mil - idle) * power / 50 if power < 50 else mil + (top - mil) * (power - 50) / 50
    tq, tb = 11.32 / (2 * vt), 30.0 / (2 * vt)
    dx = aircraft.xcg - 0.35
    s = (B > 0) - (B < 0)
    cx = two("CX", E, A) + tq * q * one("CXq")
    cy = -0.02 * B + 0.021 * D + 0.086 * R + tb * (r * one("CYr") + p * one("CYp"))
    cz = one("CZ") * (1 - be * be) - 0.19 * E / 25 + tq * q * one("CZq")
    cl = s * two("Cl", abs(B), A) + two("Cl_aileron", B, A) * D + two("Cl_rudder", B, A) * R
    cl += tb * (r * one("Clr") + p * one("Clp"))
    cm = two("Cm", E, A) + tq * q * one("Cmq") - cz * dx
    cn = s * two("Cn", abs(B), A) + two("Cn_aileron", B, A) * D + two("Cn_rudder", B, A) * R
    cn += tb * (r * one("Cnr") + p * one("Cnp")) + cy * dx * 11.32 / 30
    m, g = 1 / data["constants"]["reciprocal_mass_per_slug"], 32.17
    ca, sa, cb, sb = math.cos(al), math.sin(al), math.cos(be), math.sin(be)
    v_b = np.array([vt * ca * cb, vt * sb, vt * sa * cb])
    w_b = np.array([p, q, r])
    cph, sph, cth, sth, cps, sps = (f(a) for a in (ph, th, ps) for f in (math.cos, math.sin))
    a_b = np.array([qS * cx + push, qS * cy, qS * cz]) / m
    a_b += g * np.array([-sth, cth * sph, cth * cph]) - np.cross(w_b, v_b)
    Jx, Jy, Jz, Jxz = 9496.0, 55814.0, 63100.0, 982.0
    J = np.array([[Jx, 0, -Jxz], [0, Jy, 0], [-Jxz, 0, Jz]])
    moment = qS * np.array([30 * cl, 11.32 * cm, 30 * cn])
    w_dot = np.linalg.solve(J, moment - np.cross(w_b, J @ w_b + [160.0, 0, 0]))
    Rx = np.array([[1, 0, 0], [0, cph, -sph], [0, sph, cph]])
    Ry = np.array([[cth, 0, sth], [0, 1, 0], [-sth, 0, cth]])
    Rz = np.array([[cps, -sps, 0], [sps, cps, 0], [0, 0, 1]])
    ned = Rz @ Ry @ Rx @ v_b * 0.3048
    turning = (q * sph + r * cph) / cth
    v_dot = float(v_b @ a_b / vt)
    rates = [
        v_dot * 0.3048,
        (v_b[0] * a_b[2] - v_b[2] * a_b[0]) / (v_b[0] ** 2 + v_b[2] ** 2),
        (vt * a_b[1] - v_b[1] * v_dot) / (vt * math.hypot(v_b[0], v_b[2])),
        p + sth * turning,
        q * cph - r * sph,
        turning,
        *w_dot,
        ned[1],
        ned[0],
        -ned[2],
    ]
    command = 64.94 * thr if thr <= 0.77 else 217.38 * thr - 117.38
    high = power >= 50
    target = command if high == (command >= 50) else 40.0 if high else 60.0
    gap = target - power
    lag = 5.0 if power >= 50 else 1.0 if gap <= 25 else 0.1 if gap >= 50 else 1.9 - 0.036 * gap
    return np.array([*rates, lag * gap])


def test_the_batch_equals_the_scalar_model():
    x, u = some_flight(np.random.default_rng(7), (300,))
    u[:40] *= 1.5  # beyond the stops
    wanted = np.array([scalar(F16, a, b) for a, b in zip(x, u, strict=True)])
    np.testing.assert_allclose(derivative(F16, x, u), wanted, rtol=1e-9, atol=1e-9)
    aft = f16(0.41)
    np.testing.assert_allclose(derivative(aft, x[0], u[0]), scalar(aft, x[0], u[0]), rtol=1e-9, atol=1e-9)


def test_any_leading_axes_give_the_same():
    x, u = some_flight(np.random.default_rng(8), (2, 3, 5))
    whole = step(F16, x, u, 0.02)
    same = partial(np.testing.assert_allclose, rtol=1e-11, atol=1e-11)
    same(whole[1, 2, 4], step(F16, x[1, 2, 4], u[1, 2, 4], 0.02))
    same(whole[:, 1], step(F16, x[:, 1], u[:, 1], 0.02))
    shared = step(F16, x, u[:, :, :1], 0.02)
    same(shared[0, 0, 3], step(F16, x[0, 0, 3], u[0, 0, 0], 0.02))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-1e3, 1e3), min_size=17, max_size=17))
def test_nothing_is_ever_infinite(numbers):
    x = np.array(numbers[:13])
    x[S.POWER] = np.clip(x[S.POWER], 0.0, 100.0)
    for _ in range(5):
        assert np.isfinite(derivative(F16, x, np.array(numbers[13:]))).all()
        x[S.PITCH] = np.pi / 2
        x[S.SPEED] = 0.0


def test_the_quick_step_errs_by_millimetres():
    x, u = trim(F16, 153.0, 1000.0, 36.6, 0.5).x, trim(F16, 153.0, 1000.0, 0.0).u
    fine = quick = x
    for _ in range(250):
        fine, quick = step(F16, fine, u, 0.02), midpoint_step(F16, quick, u, 0.02)
    assert np.linalg.norm((fine - x)[[S.EAST, S.NORTH, S.UP]]) > 500.0
    np.testing.assert_allclose(quick[[S.EAST, S.NORTH, S.UP]], fine[[S.EAST, S.NORTH, S.UP]], atol=5e-3)


# ---- engine


def test_the_engine_follows_the_throttle():
    rising = solve_ivp(lambda _, p: power_rate(p, np.array([90.0])), (0, 15), [10.0], max_step=0.05).y[0]
    assert (np.diff(rising) >= -1e-9).all()
    assert rising[-1] == pytest.approx(90.0, abs=1.0)
    np.testing.assert_allclose(power_command(np.array([0.0, 0.77, 1.0])), [0.0, 50.0, 100.0], atol=5e-3)


# ---- linear model and regulator


def test_linearisation_against_finite_differences_one_by_one():
    about = trim(F16, 153.0, 1000.0, 36.6, 0.3)
    A, B = linearise(F16, about.x, about.u)
    z = np.concatenate([about.x, about.u])
    # The slope in beta jumps at 0, close by: there the two may differ a little.
    J = approx_fprime(z, lambda z: derivative(F16, z[:13], z[13:]), epsilon=1e-6 * np.maximum(1.0, np.abs(z)))
    np.testing.assert_allclose(np.hstack([A, B]), J, rtol=5e-4, atol=2e-5)


def test_the_linear_model_predicts_the_nonlinear_one():
    about = trim(F16, 153.0, 1000.0)
    A, B = linearise(F16, about.x, about.u)
    rng = np.random.default_rng(9)
    scale = np.array([0.1, *[1e-3] * 8, 0, 0, 1.0, 0.0])
    x = scale * rng.normal(size=(50, 13))
    u = 1e-3 * rng.normal(size=(50, 4)) * [0, 1, 1, 1]
    flown, steady, linear = about.x + x, about.x, x
    for _ in range(25):
        flown, steady = step(F16, flown, about.u + u, 0.02), step(F16, steady, about.u, 0.02)
        k = linear
        for order in (4, 3, 2, 1):  # the same step of order 4, for the linear model
            k = linear + (0.02 / order) * (k @ A.T + u @ B.T)
        linear = k
    error = np.abs(flown - steady - linear).max(axis=0)
    assert (error <= 0.02 * np.abs(linear).max(axis=0) + 1e-9).all()


def test_the_printed_longitudinal_model():
    """Section 3.7 of the source: speed [ft/s], alpha, pitch, pitch rate [rad], elevator [deg]."""
    about = trim(F16, 502.0 * FOOT, 0.0)
    A, B = linearise(F16, about.x, about.u)
    chosen = [S.SPEED, S.ALPHA, S.PITCH, S.Q]
    A, B = A[np.ix_(chosen, chosen)], np.deg2rad(B[chosen, C.ELEVATOR])
    A[0] /= FOOT
    A[:, 0] *= FOOT
    B[0] /= FOOT
    printed = [
        [-1.9311e-02, 8.8157e00, -3.2170e01, -5.7499e-01],
        [-2.5389e-04, -1.0189e00, 0.0, 9.0506e-01],
        [0.0, 0.0, 0.0, 1.0],
        [0.0, 8.2225e-01, 0.0, -1.0774e00],
    ]
    np.testing.assert_allclose(A, printed, rtol=3e-4, atol=1e-9)
    np.testing.assert_allclose(B, [1.7370e-01, -2.1499e-03, 0.0, -1.7555e-01], rtol=3e-4, atol=1e-9)


def test_lqr_solves_the_riccati_equation_and_stabilises():
    A, B = np.array([[0.0, 1.0], [2.0, 0.3]]), np.array([[0.0], [1.0]])
    K = lqr(A, B, [0.5, 1.0], [2.0])
    assert np.linalg.eigvals(A - B @ K).real.max() < 0.0
    # Kalman's identity: the return difference of an optimal regulator is at least 1 at every frequency.
    for w in np.logspace(-2, 2, 40):
        L = (K @ np.linalg.inv(1j * w * np.eye(2) - A) @ B)[0, 0]
        assert abs(1.0 + L) >= 1.0 - 1e-9


@pytest.mark.parametrize("xcg", [0.35, 0.38])
def test_the_regulated_aircraft_is_stable_where_the_bare_one_is_not(xcg):
    aircraft = f16(xcg)
    about = trim(aircraft, 153.0, 1000.0)
    K = regulator(aircraft, about, [5, 0.03, 0.02, 0.1, 0.05, 0.3, 0.1, 0.1, 5, 10], [0.2, 0.1, 0.1, 0.1])
    A, B = linearise(aircraft, about.x, about.u)
    chosen = list(REGULATED)
    closed = A[np.ix_(chosen, chosen)] - B[chosen] @ K
    assert np.linalg.eigvals(closed).real.max() < -0.05
    if xcg > 0.36:
        assert np.linalg.eigvals(A[np.ix_(chosen, chosen)]).real.max() > 0.1
    x = about.x.copy()
    x[[S.ALPHA, S.ROLL, S.Q, S.UP]] += [0.05, 0.3, 0.1, 10.0]
    for _ in range(1500):
        x = step(aircraft, x, about.u - K @ (x - about.x)[chosen], 0.02)
    np.testing.assert_allclose((x - about.x)[[S.ALPHA, S.ROLL, S.PITCH, S.Q]], 0.0, atol=2e-3)
    assert x[S.UP] == pytest.approx(1000.0, abs=1.0)
