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
from functools import cached_property

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
# One cell beyond the published range the tables go on as they left it; further out they hold. Rows as for the tables.
_alpha, _beta = (np.deg2rad(-15.0), np.deg2rad(50.0)), np.deg2rad(35.0)
_elevator = CONTROL_MAX[C.ELEVATOR]
_LEAST = np.array([-_elevator, -_beta, -_beta, 0.0, *[_alpha[0]] * 3, 0.0])[:, None]
_MOST = np.array([_elevator, _beta, _beta, 1.2, *[_alpha[1]] * 3, 50000.0 * FOOT])[:, None]
_SLOWEST = 10.0
"""Speed [m/s] below which angles no longer change faster: the wind axes mean nothing at rest."""
_STEEPEST = 0.01
"""Least cosine of pitch: Euler rates stay finite within half a degree of the vertical."""
_SEA_LEVEL_DENSITY = 0.002377 * SLUG / FOOT**3
_GAS = 1.4 * 1716.3 * FOOT**2
_MEASURED_AT = np.deg2rad([[20.0], [30.0]])
"""Aileron and rudder of the tables of their moments."""
_Q_R_P = np.array([S.Q, S.R, S.P])
_LENGTHS = np.array([[CHORD], [SPAN], [SPAN]])
_ARMS = np.array([SPAN, CHORD, SPAN])
_AROUND = np.array([S.P, S.Q, S.R, S.P, S.Q])


@dataclass(frozen=True, eq=False)
class Body:
    """An aircraft's constants as arrays: inertia and its inverse ``(3, 3)``, and what a coefficient times dynamic
    pressure and wing area gives, ``(2, 3, 1)``: forces a unit of mass, and moments."""

    inertia: Array
    inverse_inertia: Array
    scale: Array


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

    @cached_property
    def body(self) -> Body:
        """What the equations of motion need of it."""
        Jx, Jy, Jz, Jxz = self.inertia
        J = np.array([[Jx, 0.0, -Jxz], [0.0, Jy, 0.0], [-Jxz, 0.0, Jz]])
        force, moment = np.full(3, self.force_factor / self.mass), self.moment_factor * _ARMS
        return Body(J, np.linalg.inv(J), np.stack([force, moment])[..., None])

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


def aerodynamics(aircraft: Aircraft, x: Array, u: Array) -> tuple[Array, Array]:
    """Coefficients CX, CY, CZ, Cl, Cm, Cn (..., 6) about the aircraft's own centre of gravity, and thrust (...) [N]."""
    shape, rows, held = _by_rows(x, u)
    coefficients, thrust = _aerodynamics(aircraft, rows, held, atmosphere(rows[S.UP])[1])
    factors = np.repeat([aircraft.force_factor, aircraft.moment_factor], 3)
    return _by_points(coefficients * factors[:, None], shape), thrust.reshape(shape)


def steady_thrust(throttle: Array, speed: float, height: float) -> Array:
    """Thrust (...) [N] of throttle settings (...) that are held, at a speed [m/s] and height [m]."""
    x = np.zeros((*throttle.shape, STATES))
    x[..., S.SPEED], x[..., S.UP], x[..., S.POWER] = speed, height, power_command(throttle)
    return aerodynamics(f16(), x, np.zeros(CONTROLS))[1]


def derivative(aircraft: Aircraft, x: Array, u: Array) -> Array:
    """Rate of change of states ``(..., 13)`` under controls ``(..., 4)``; controls beyond their stops count as at them.

    Flight below 10 m/s and within half a degree of the vertical is not described well; the result stays finite there.
    """
    shape, rows, held = _by_rows(x, u)
    return _by_points(_derivative(aircraft, rows, held), shape)


def step(aircraft: Aircraft, x: Array, u: Array, dt: float) -> Array:
    """States ``(..., 13)`` after ``dt`` [s] under constant controls ``(..., 4)``: one Runge-Kutta step of order 4."""
    shape, rows, held = _by_rows(x, u)
    k1 = _derivative(aircraft, rows, held)
    k2 = _derivative(aircraft, rows + (0.5 * dt) * k1, held)
    k3 = _derivative(aircraft, rows + (0.5 * dt) * k2, held)
    k4 = _derivative(aircraft, rows + dt * k3, held)
    return _by_points(rows + (dt / 6.0) * (k1 + 2.0 * (k2 + k3) + k4), shape)


def midpoint_step(aircraft: Aircraft, x: Array, u: Array, dt: float) -> Array:
    """As :func:`step`, of order 2, at half the cost: at 0.02 s it errs by millimetres in a quarter of a minute."""
    shape, rows, held = _by_rows(x, u)
    middle = rows + (0.5 * dt) * _derivative(aircraft, rows, held)
    return _by_points(rows + dt * _derivative(aircraft, middle, held), shape)


# ---- inside: one row for each quantity, one column for each of n points, so that NumPy runs along memory -------------


@dataclass(frozen=True, slots=True)
class _Held:
    """What controls that are held over a step do, whatever the state: ``(n,)`` where not said."""

    elevator: Array
    side: Array
    """CY of aileron and rudder."""
    lift: Array
    """CZ of the elevator."""
    turning: Array
    """How far aileron and rudder are out, of what the tables were measured at, as (2, 1, n)."""
    power: Array
    """Commanded [%]."""


def _by_rows(x: Array, u: Array) -> tuple[tuple[int, ...], Array, _Held]:
    """Leading shape of states (..., 13) and controls (..., 4); states as rows (13, n); what the controls do."""
    shape = np.broadcast_shapes(x.shape[:-1], u.shape[:-1])
    if x.shape[:-1] != shape:
        x = np.broadcast_to(x, (*shape, STATES))
    rows = np.ascontiguousarray(x.reshape(-1, STATES).T)
    u = np.minimum(np.maximum(u, CONTROL_MIN), CONTROL_MAX)
    if u.shape[:-1] != shape:
        u = np.broadcast_to(u, (*shape, CONTROLS))
    throttle, elevator, *surfaces = np.ascontiguousarray(u.reshape(-1, CONTROLS).T)
    turning = np.array(surfaces) / _MEASURED_AT
    side, lift = 0.021 * turning[0] + 0.086 * turning[1], (-0.19 / _elevator) * elevator
    return shape, rows, _Held(elevator, side, lift, turning[:, None], power_command(throttle))


def _by_points(rows: Array, shape: tuple[int, ...]) -> Array:
    """Rows (m, n) as (..., m)."""
    return np.ascontiguousarray(rows.T).reshape(*shape, len(rows))


def _aerodynamics(aircraft: Aircraft, x: Array, held: _Held, sound: Array) -> tuple[Array, Array]:
    """Coefficients as published (6, n) about the aircraft's own centre of gravity, and thrust (n,) [N]."""
    V = x[S.SPEED]
    variables = np.empty((8, x.shape[1]))
    variables[0] = held.elevator
    variables[1:3] = x[S.BETA]
    variables[3] = V / sound
    variables[4:7] = x[S.ALPHA]
    variables[7] = x[S.UP]
    np.maximum(variables, _LEAST, out=variables)
    np.minimum(variables, _MOST, out=variables)
    beta = variables[2]
    np.abs(beta, out=variables[1])
    (longitudinal, lateral, controls, engine), curves = _TABLES.look_up(variables)
    # The curves after the first stand as q, r, p by three: of X, Z, M what q does; of Y, L, N what r and p do.
    half = 0.5 / np.maximum(V, _SLOWEST)
    rates = x.take(_Q_R_P, axis=0) * half
    rates *= _LENGTHS
    damping = curves[1:].reshape(3, 3, -1) * rates[:, None]
    pitching, turning = damping[0], damping[1] + damping[2]

    C6 = np.empty((6, x.shape[1]))
    CX, CY, CZ, _, Cm, Cn = C6
    np.add(longitudinal[0], pitching[0], out=CX)
    np.add((-0.02 * 180.0 / np.pi) * beta, held.side, out=CY)
    CY += turning[0]
    np.multiply(curves[0], 1.0 - beta * beta, out=CZ)
    CZ += held.lift
    CZ += pitching[1]
    # Roll and yaw in one go: what sideslip, aileron and rudder, and rates do.
    roll_and_yaw = C6[3::2]
    np.multiply(lateral[:2], np.sign(beta), out=roll_and_yaw)
    roll_and_yaw += turning[1:]
    deflected = controls.reshape(2, 2, -1) * held.turning
    roll_and_yaw += deflected[0]
    roll_and_yaw += deflected[1]
    offset = XCG_REFERENCE - aircraft.xcg
    np.add(longitudinal[1], pitching[2], out=Cm)
    if offset != 0.0:
        Cm += CZ * offset
        Cn -= CY * (offset * CHORD / SPAN)

    share = 0.02 * x[S.POWER]
    idle, military, maximum = engine[:3]
    thrust = idle + (military - idle) * np.minimum(share, 1.0) + (maximum - military) * np.maximum(share - 1.0, 0.0)
    return C6, thrust


def _derivative(aircraft: Aircraft, x: Array, held: _Held) -> Array:
    """Rate of change of states as rows (13, n)."""
    V, p, q, r = x[S.SPEED], x[S.P], x[S.Q], x[S.R]
    density, sound = atmosphere(x[S.UP])
    coefficients, thrust = _aerodynamics(aircraft, x, held, sound)
    area = (0.5 * WING_AREA) * density * V * V
    sa, sb, sr, sp, sh = np.sin(x[S.ALPHA : S.HEADING + 1])
    ca, cb, cr, cp, ch = np.cos(x[S.ALPHA : S.HEADING + 1])
    body = aircraft.body

    # Velocity and angular momentum, the first two components again at the end: cross products are then slices.
    turning = x.take(_AROUND, axis=0)
    carried = np.empty((2, 5, x.shape[1]))
    velocity, momentum = carried
    along = V * cb
    np.multiply(along, ca, out=velocity[0])
    np.multiply(V, sb, out=velocity[1])
    np.multiply(along, sa, out=velocity[2])
    momentum[:3] = body.inertia @ x[S.P : S.R + 1]
    momentum[0] += aircraft.engine_momentum
    carried[:, 3:] = carried[:, :2]
    # Newton and Euler: forces a unit of mass and moments, less the turning of what is carried along.
    both = coefficients.reshape(2, 3, -1) * area
    both *= body.scale
    both += turning[2:] * carried[:, 1:4]
    both -= turning[1:4] * carried[:, 2:]
    (U_dot, V_dot, W_dot), moment = both
    U, Vy, W = velocity[:3]
    level = GRAVITY * cp
    U_dot += thrust / aircraft.mass
    U_dot -= GRAVITY * sp
    V_dot += level * sr
    W_dot += level * cr

    dx = np.empty_like(x)
    forward_dot = ca * U_dot + sa * W_dot
    dx[S.SPEED] = cb * forward_dot + sb * V_dot
    dx[S.ALPHA] = (U * W_dot - W * U_dot) / np.maximum(along * along, _SLOWEST**2)
    dx[S.BETA] = (cb * V_dot - sb * forward_dot) / np.maximum(V, _SLOWEST)

    # Attitude.
    heading_dot = (q * sr + r * cr) / np.copysign(np.maximum(np.abs(cp), _STEEPEST), cp)
    dx[S.ROLL] = p + sp * heading_dot
    dx[S.PITCH] = q * cr - r * sr
    dx[S.HEADING] = heading_dot
    np.matmul(body.inverse_inertia, moment, out=dx[S.P : S.R + 1])

    # Where it goes.
    down = sr * Vy + cr * W
    right = cr * Vy - sr * W
    forward = cp * U + sp * down
    dx[S.EAST] = sh * forward + ch * right
    dx[S.NORTH] = ch * forward - sh * right
    dx[S.UP] = sp * U - cp * down
    dx[S.POWER] = power_rate(x[S.POWER], held.power)
    return dx
