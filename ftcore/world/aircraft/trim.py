"""Steady flight: the controls that hold it, the linear model about it, and the gain that keeps it.

Source: B.L. Stevens and F.L. Lewis, Aircraft Control and Simulation, sections 3.6 (trim), 3.7 (linearisation) and 5
(linear quadratic regulator).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_continuous_are

from ftcore.world.aircraft.dynamics import (
    CONTROL_MAX,
    CONTROL_MIN,
    CONTROLS,
    GRAVITY,
    STATES,
    Aircraft,
    S,
    aerodynamics,
    derivative,
    power_command,
)

Array = NDArray[np.float64]

STEADY = (S.SPEED, S.ALPHA, S.BETA, S.P, S.Q, S.R)
"""States that stand still in trimmed flight."""

REGULATED = (S.SPEED, S.ALPHA, S.BETA, S.ROLL, S.PITCH, S.P, S.Q, S.R, S.UP, S.POWER)
"""States that the regulator feeds back: all but where it is and where it heads."""

TOLERANCE = 1e-9
"""Largest acceleration left in a trim [SI]."""

_STEP = np.array([1.0, *[1e-3] * 8, 10.0, 10.0, 10.0, 0.1])
_CONTROL_STEP = np.array([1e-3, 1e-3, 1e-3, 1e-3])


@dataclass(frozen=True, eq=False)
class Trim:
    """Steady flight: state ``(13,)``, controls ``(4,)`` and the steady turn rate [rad/s]."""

    x: Array
    u: Array
    turn_rate: float


def trim(
    aircraft: Aircraft, speed: float, height: float, climb_rate: float = 0.0, bank: float = 0.0, heading: float = 0.0
) -> Trim:
    """Controls and attitude that hold a speed [m/s], height [m], climb rate [m/s] and bank [rad].

    The turn is coordinated: no aerodynamic side force. Height counts for the air's density only.
    Raises ValueError when there is no such flight within the aircraft's controls; the message says what was asked.
    """
    from scipy.optimize import root  # takes a while to load, and few flights need it

    asked = f"{speed:g} m/s at {height:g} m, climbing {climb_rate:g} m/s, banked {np.rad2deg(bank):g} deg"
    if not speed > 0.0 or not abs(climb_rate) < speed or not abs(bank) < 0.5 * np.pi:
        raise ValueError(f"no steady flight can be {asked}")

    def flight(unknown: Array) -> tuple[Array, Array, float]:
        alpha, beta, pitch, throttle, elevator, aileron, rudder, turn = unknown
        rates = turn * np.array([-np.sin(pitch), np.sin(bank) * np.cos(pitch), np.cos(bank) * np.cos(pitch)])
        power = float(power_command(np.asarray(throttle)))
        x = np.array([speed, alpha, beta, bank, pitch, heading, *rates, 0.0, 0.0, height, power])
        return x, np.array([throttle, elevator, aileron, rudder]), float(turn)

    def imbalance(unknown: Array) -> Array:
        x, u, _ = flight(unknown)
        dx = derivative(aircraft, x, u)
        side = aerodynamics(aircraft, x, u)[0][1]
        return np.array([*dx[list(STEADY)], dx[S.UP] - climb_rate, side])

    climb = np.arcsin(climb_rate / speed)
    turn = GRAVITY * np.tan(bank) / speed
    # Forces are stiff in alpha: it is found from a few starts, the nearest to ordinary flight first.
    for alpha in (0.05, 0.15, 0.3):
        found = root(imbalance, [alpha, 0.0, alpha + climb, 0.3, -0.03, 0.0, 0.0, turn], method="hybr", tol=1e-13)
        x, u, rate = flight(found.x)
        inside = ((u >= CONTROL_MIN) & (u <= CONTROL_MAX)).all() and abs(x[S.ALPHA]) < np.deg2rad(45.0)
        if inside and np.abs(imbalance(found.x)).max() < TOLERANCE:
            return Trim(x, u, rate)
    raise ValueError(f"no steady flight within the controls' range: {asked}")


def linearise(aircraft: Aircraft, x: Array, u: Array) -> tuple[Array, Array]:
    """Jacobians A (13, 13) and B (13, 4) of the flight dynamics at a state (13,) and controls (4,).

    Central differences with Richardson's extrapolation, all points in one call. At the edge of a table's cell the slope
    is the mean of both sides.
    """
    steps = np.concatenate([_STEP, _CONTROL_STEP])
    moves = np.concatenate([np.diag(steps * sign * size) for size in (1.0, 0.5) for sign in (1.0, -1.0)])
    dx = derivative(aircraft, x + moves[:, :STATES], u + moves[:, STATES:]).reshape(2, 2, STATES + CONTROLS, STATES)
    wide, narrow = (dx[:, 0] - dx[:, 1]) / (2.0 * steps[:, None] * np.array([1.0, 0.5])[:, None, None])
    jacobian = ((4.0 * narrow - wide) / 3.0).T
    return jacobian[:, :STATES].copy(), jacobian[:, STATES:].copy()


def lqr(A: Array, B: Array, state_scale: ArrayLike, control_scale: ArrayLike) -> Array:
    """Gain K (m, n) of u = -K x that minimises the integral of (x / state_scale)^2 + (u / control_scale)^2.

    Shapes: A (n, n), B (n, m). The scales are deviations that weigh alike (Bryson's rule), in the units of x and u.
    Raises numpy.linalg.LinAlgError when (A, B) cannot be stabilised.
    """
    Q = np.diag(1.0 / np.square(np.asarray(state_scale, dtype=float)))
    inverse_R = np.diag(np.square(np.asarray(control_scale, dtype=float)))
    P = solve_continuous_are(A, B, Q, np.linalg.inv(inverse_R))
    return np.asarray(inverse_R @ B.T @ P)


def regulator(aircraft: Aircraft, about: Trim, state_scale: ArrayLike, control_scale: ArrayLike) -> Array:
    """Gain (4, 10) from deviations of the :data:`REGULATED` states to deviations of the controls, about a trim."""
    A, B = linearise(aircraft, about.x, about.u)
    chosen = list(REGULATED)
    return lqr(A[np.ix_(chosen, chosen)], B[chosen], state_scale, control_scale)
