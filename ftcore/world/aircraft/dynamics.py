"""Nonlinear flight dynamics of the F-16: six degrees of freedom and an engine, any number of aircraft at once.

A state is an array ``(..., 13)`` in the order of :class:`S`, a control ``(..., 4)`` in the order of :class:`C`; all SI
and radians, power in per cent. Leading axes are free (runs, twins, sigma points) and broadcast. The Earth is flat and
does not turn; the air is at rest. Signs are the source's: positive elevator pitches down, positive aileron and rudder
bring positive moments about the body's x and z axes with the signs of the tables.

Source: B.L. Stevens and F.L. Lewis, Aircraft Control and Simulation, sections 2.5 and 3.5, appendix A.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ftcore.world.aircraft.tables import FOOT, SLUG, SLUG_FT2, published, tables

Array = NDArray[np.float64]


class S(IntEnum):
    """Places in a state: speed [m/s], angles [rad], rates [rad/s], position [m], engine power [%]."""

    SPEED = 0
    ALPHA = 1
    BETA = 2
    ROLL = 3
    PITCH = 4
    HEADING = 5
    P = 6
    Q = 7
    R = 8
    EAST = 9
    NORTH = 10
    UP = 11
    POWER = 12


class C(IntEnum):
    """Places in a control: throttle 0 to 1, surfaces [rad]."""

    THROTTLE = 0
    ELEVATOR = 1
    AILERON = 2
    RUDDER = 3


STATES, CONTROLS = len(S), len(C)

_constants = published()["constants"]
_limits = published()["limits"]
_surface = np.deg2rad([_limits["elevator_deg"], _limits["aileron_deg"], _limits["rudder_deg"]])
CONTROL_MIN = np.array([0.0, *-_surface])
CONTROL_MAX = np.array([1.0, *_surface])

GRAVITY = _constants["g_ft_s2"] * FOOT
WING_AREA = _constants["wing_area_ft2"] * FOOT**2
SPAN = _constants["span_ft"] * FOOT
CHORD = _constants["mean_chord_ft"] * FOOT
XCG_REFERENCE = _constants["xcg_reference_chord"]

_TABLES = tables()
# One cell beyond the published range the tables go on as they left it; further out they hold.
_ALPHA_RANGE = (np.deg2rad(-15.0), np.deg2rad(50.0))
_BETA_LIMIT = np.deg2rad(35.0)
_FASTEST_MACH, _HIGHEST = 1.2, 50000.0 * FOOT
_SLOWEST = 10.0
"""Speed [m/s] below which angles no longer change faster: the wind axes mean nothing at rest."""
_STEEPEST = 0.01
"""Least cosine of pitch: Euler rates stay finite within half a degree of the vertical."""
_SEA_LEVEL_DENSITY = 0.002377 * SLUG / FOOT**3
_GAS = 1.4 * 1716.3 * FOOT**2
_AILERON, _RUDDER = np.deg2rad(20.0), np.deg2rad(30.0)


@dataclass(frozen=True)
class Aircraft:
    """What distinguishes one F-16 from another.

    Attributes:
        mass: [kg].
        inertia: Jx, Jy, Jz, Jxz [kg m^2].
        engine_momentum: angular momentum of the engine about the body's x axis [kg m^2/s].
        xcg: centre of gravity, fraction of the mean chord; the tables' reference is 0.35.
        force_factor, moment_factor: multiply all aerodynamic forces and moments (1: as published).
    """

    mass: float
    inertia: tuple[float, float, float, float]
    engine_momentum: float
    xcg: float
    force_factor: float = 1.0
    moment_factor: float = 1.0

    def differing(self, mass: float = 0.0, xcg: float = 0.0, aerodynamics: float = 0.0) -> Aircraft:
        """One that is heavier by the fraction ``mass`` (inertia with it), with its centre of gravity ``xcg`` chords
        further aft, and with aerodynamic forces larger and moments smaller by the fraction ``aerodynamics``."""
        jx, jy, jz, jxz = (j * (1.0 + mass) for j in self.inertia)
        return Aircraft(
            self.mass * (1.0 + mass),
            (jx, jy, jz, jxz),
            self.engine_momentum,
            self.xcg + xcg,
            self.force_factor * (1.0 + aerodynamics),
            self.moment_factor * (1.0 - aerodynamics),
        )


def f16(xcg: float = XCG_REFERENCE) -> Aircraft:
    """The published aircraft."""
    c = _constants
    jx, jy, jz, jxz = (c[f"{name}_slug_ft2"] * SLUG_FT2 for name in ("Jx", "Jy", "Jz", "Jxz"))
    return Aircraft(
        mass=SLUG / c["reciprocal_mass_per_slug"],
        inertia=(jx, jy, jz, jxz),
        engine_momentum=c["engine_angular_momentum_slug_ft2_s"] * SLUG_FT2,
        xcg=xcg,
    )


def atmosphere(height: Array) -> tuple[Array, Array]:
    """Density [kg/m^3] and speed of sound [m/s] at heights (...) [m]."""
    factor = np.maximum(1.0 - (0.703e-5 / FOOT) * height, 0.05)
    temperature = np.where(height >= 35000.0 * FOOT, 390.0, 519.0 * factor)
    return _SEA_LEVEL_DENSITY * factor**4.14, np.sqrt(_GAS * temperature)


def power_command(throttle: Array) -> Array:
    """Power [%] that a throttle setting (...) asks for."""
    return np.asarray(np.where(throttle <= 0.77, 64.94 * throttle, 217.38 * throttle - 117.38))


def power_rate(power: Array, command: Array) -> Array:
    """Rate of change of power [%/s], (...): a first-order lag whose speed depends on the gap."""
    high = power >= 50.0
    gap = np.where(high == (command >= 50.0), command, np.where(high, 40.0, 60.0)) - power
    return np.asarray(np.where(high, 5.0, np.minimum(np.maximum(1.9 - 0.036 * gap, 0.1), 1.0)) * gap)


def aerodynamics(aircraft: Aircraft, x: Array, u: Array, mach: Array) -> tuple[Array, ...]:
    """Coefficients CX, CY, CZ, Cl, Cm, Cn about the aircraft's own centre of gravity, and thrust [N]; (...) each."""
    alpha, beta = x[..., S.ALPHA], np.minimum(np.maximum(x[..., S.BETA], -_BETA_LIMIT), _BETA_LIMIT)
    variables = np.empty((8, *np.broadcast_shapes(mach.shape, u.shape[:-1])))
    variables[0] = u[..., C.ELEVATOR]
    variables[1] = np.abs(beta)
    variables[2] = beta
    variables[3] = np.minimum(mach, _FASTEST_MACH)
    variables[4:7] = np.minimum(np.maximum(alpha, _ALPHA_RANGE[0]), _ALPHA_RANGE[1])
    variables[7] = np.minimum(np.maximum(x[..., S.UP], 0.0), _HIGHEST)
    surfaces, curves = _TABLES.look_up(variables)
    longitudinal, lateral, controls, engine = surfaces
    elevator, aileron, rudder = u[..., C.ELEVATOR], u[..., C.AILERON] / _AILERON, u[..., C.RUDDER] / _RUDDER
    half = 0.5 / np.maximum(x[..., S.SPEED], _SLOWEST)
    p, q, r = SPAN * half * x[..., S.P], CHORD * half * x[..., S.Q], SPAN * half * x[..., S.R]
    # The tables of rate derivatives stand in the order q, r, p, for X and Y, for Z and L, for M and N.
    rates = np.empty(curves.shape[:-1] + (9,))
    rates[..., 0::3], rates[..., 1::3], rates[..., 2::3] = q[..., None], r[..., None], p[..., None]
    rates *= curves[..., 1:]
    side = np.sign(beta)
    offset = XCG_REFERENCE - aircraft.xcg

    CX = longitudinal[..., 0] + rates[..., 0]
    CY = (-0.02 * 180.0 / np.pi) * beta + 0.021 * aileron + 0.086 * rudder + rates[..., 1] + rates[..., 2]
    CZ = curves[..., 0] * (1.0 - beta * beta) - (0.19 / CONTROL_MAX[C.ELEVATOR]) * elevator + rates[..., 3]
    # Moments: what sideslip, aileron, rudder and rates do, in one go for roll and yaw.
    turning = side[..., None] * lateral[..., :2] + rates[..., 4::3] + rates[..., 5::3]
    turning += controls[..., :2] * aileron[..., None] + controls[..., 2:] * rudder[..., None]
    Cl = turning[..., 0]
    Cm = longitudinal[..., 1] + rates[..., 6] + CZ * offset
    Cn = turning[..., 1] - CY * (offset * CHORD / SPAN)

    share = 0.02 * x[..., S.POWER]
    idle, military, maximum = engine[..., 0], engine[..., 1], engine[..., 2]
    thrust = np.where(share < 1.0, idle + (military - idle) * share, military + (maximum - military) * (share - 1.0))
    force, moment = aircraft.force_factor, aircraft.moment_factor
    return CX * force, CY * force, CZ * force, Cl * moment, Cm * moment, Cn * moment, thrust


def derivative(aircraft: Aircraft, x: Array, u: Array) -> Array:
    """Rate of change of states ``(..., 13)`` under controls ``(..., 4)``; controls beyond their stops count as at them.

    Flight below 10 m/s and within half a degree of the vertical is not described well; the result stays finite there.
    """
    shape = np.broadcast_shapes(x.shape[:-1], u.shape[:-1])
    u = np.minimum(np.maximum(u, CONTROL_MIN), CONTROL_MAX)
    V, p, q, r = x[..., S.SPEED], x[..., S.P], x[..., S.Q], x[..., S.R]
    speed = np.maximum(V, _SLOWEST)
    density, sound = atmosphere(x[..., S.UP])
    CX, CY, CZ, Cl, Cm, Cn, thrust = aerodynamics(aircraft, x, u, V / sound)
    area = (0.5 * WING_AREA) * density * V * V
    sines, cosines = np.sin(x[..., S.ALPHA : S.HEADING + 1]), np.cos(x[..., S.ALPHA : S.HEADING + 1])
    sa, sb, sr, sp, sh = (sines[..., i] for i in range(5))
    ca, cb, cr, cp, ch = (cosines[..., i] for i in range(5))
    along = V * cb
    U, W, Vy = along * ca, along * sa, V * sb

    # Forces, body axes.
    per_mass = area / aircraft.mass
    level = GRAVITY * cp
    U_dot = r * Vy - q * W - GRAVITY * sp + per_mass * CX + thrust / aircraft.mass
    V_dot = p * W - r * U + level * sr + per_mass * CY
    W_dot = q * U - p * Vy + level * cr + per_mass * CZ
    dx = np.empty((*shape, STATES))
    forward_dot = ca * U_dot + sa * W_dot
    speed_dot = cb * forward_dot + sb * V_dot
    dx[..., S.SPEED] = speed_dot
    dx[..., S.ALPHA] = (U * W_dot - W * U_dot) / np.maximum(along * along, _SLOWEST**2)
    dx[..., S.BETA] = (cb * V_dot - sb * forward_dot) / speed

    # Attitude.
    turning = q * sr + r * cr
    heading_dot = turning / np.copysign(np.maximum(np.abs(cp), _STEEPEST), cp)
    dx[..., S.ROLL] = p + sp * heading_dot
    dx[..., S.PITCH] = q * cr - r * sr
    dx[..., S.HEADING] = heading_dot

    # Moments, with the engine's angular momentum along x.
    Jx, Jy, Jz, Jxz = aircraft.inertia
    hx = aircraft.engine_momentum
    L = area * SPAN * Cl + q * ((Jy - Jz) * r + Jxz * p)
    N = area * SPAN * Cn + q * ((Jx - Jy) * p - Jxz * r + hx)
    both = 1.0 / (Jx * Jz - Jxz * Jxz)
    dx[..., S.P] = (both * Jz) * L + (both * Jxz) * N
    dx[..., S.Q] = (area * CHORD * Cm + r * ((Jz - Jx) * p - hx) - Jxz * (p * p - r * r)) / Jy
    dx[..., S.R] = (both * Jxz) * L + (both * Jx) * N

    # Where it goes.
    down = sr * Vy + cr * W
    right = cr * Vy - sr * W
    forward = cp * U + sp * down
    dx[..., S.EAST] = sh * forward + ch * right
    dx[..., S.NORTH] = ch * forward - sh * right
    dx[..., S.UP] = sp * U - cp * down
    dx[..., S.POWER] = power_rate(x[..., S.POWER], power_command(u[..., C.THROTTLE]))
    return dx


def step(aircraft: Aircraft, x: Array, u: Array, dt: float) -> Array:
    """States ``(..., 13)`` after ``dt`` [s] under constant controls ``(..., 4)``: one Runge-Kutta step of order 4."""
    k1 = derivative(aircraft, x, u)
    k2 = derivative(aircraft, x + (0.5 * dt) * k1, u)
    k3 = derivative(aircraft, x + (0.5 * dt) * k2, u)
    k4 = derivative(aircraft, x + dt * k3, u)
    return np.asarray(x + (dt / 6.0) * (k1 + 2.0 * (k2 + k3) + k4))


def midpoint_step(aircraft: Aircraft, x: Array, u: Array, dt: float) -> Array:
    """As :func:`step`, of order 2, at half the cost: at 0.02 s it errs by millimetres in a quarter of a minute."""
    middle = x + (0.5 * dt) * derivative(aircraft, x, u)
    return np.asarray(x + dt * derivative(aircraft, middle, u))
