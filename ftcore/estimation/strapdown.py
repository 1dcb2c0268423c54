"""Strapdown navigation: inertial samples to position, velocity and attitude on WGS-84, in batches over runs.

Conventions of :mod:`ftcore.earth`: n is local-level east-north-up, b is forward-right-down, SI and radians. Every array
leads with the run axis; an axis of length 1 broadcasts.

Two speeds (Savage 1998, parts 1 and 2):

1. *Fast*, in the body frame, at the sample rate. Samples become rotation vectors and velocity increments compensated
   for coning, rotation, sculling and scrolling. The rate of change inside a sample is taken from its two neighbours (at
   the ends of the interval by extrapolation). Each sample is then one 5x5 matrix
   ``[[C, dv, dp], [0, 1, dt], [0, 0, 1]]`` (rotation, and the first and second integral of specific force); their
   ordered product is the whole interval, found pairwise in log2(N) batched multiplications. No loop over samples.
2. *Slow*, in the navigation frame, once an interval. Gravity, Coriolis, transport and Earth rate are predicted at the
   middle and the end of the interval and integrated by Simpson's rule, which keeps a 1 s interval accurate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftcore import earth
from ftcore.rotation import ordered_product, rotation_coefficients

Array = NDArray[np.float64]

# Runs are taken through the fast recursion in blocks of about this many samples: larger temporaries come fresh from the
# operating system on every call, and their page faults cost more than the arithmetic.
_BLOCK_SAMPLES: Final = 800

DEFAULT_DAMPING_TIME: Final = 30.0
"""Time constant of the damped vertical channel where a scenario is silent [s]."""


@dataclass(frozen=True, slots=True)
class InsState:
    """Indicated navigation state.

    ``lla`` (runs, 3): latitude, longitude [rad], height [m]; ``v_n`` (runs, 3): velocity over the Earth [m/s];
    ``C_nb`` (runs, 3, 3): body to local level.
    """

    lla: Array
    v_n: Array
    C_nb: Array


@dataclass(frozen=True, slots=True)
class Interval:
    """What an error model needs to know about the interval just integrated: means over it, and the attitude in it.

    ``duration`` [s]; ``lla`` (runs, 3); ``v_n`` (runs, 3) [m/s]; ``f_n`` (runs, 3): specific force [m/s^2]; ``C_nb``
    (runs, 3, 3): *mean* of the body-to-level matrix, so that a constant bias times it times the duration is what the
    bias integrates to; it is orthogonal only up to the square of the angle turned. ``C_nb_nodes`` (3, runs, 3, 3): the
    matrices at the start, in the middle and at the end, and ``node_weights`` the quadrature that makes a mean of them.
    """

    duration: float
    lla: Array
    v_n: Array
    f_n: Array
    C_nb: Array
    C_nb_nodes: Array
    node_weights: tuple[float, float, float]


def propagate(state: InsState, omega_b: Array, f_b: Array, dt: float) -> tuple[InsState, Interval]:
    """Integrate N inertial samples, ``N * dt`` seconds of flight.

    ``omega_b`` (runs, N, 3) rad/s and ``f_b`` (runs, N, 3) m/s^2 are means over each sample interval of ``dt`` seconds
    (increments divided by dt), N >= 1. Returns the new state and the :class:`Interval` summary.

    Raises:
        ValueError: the samples are not (runs, N, 3), or dt is not positive.

    Meant for intervals up to about 1 s; call it repeatedly for more. Not valid within metres of a pole.
    """
    if omega_b.ndim != 3 or omega_b.shape[1:] != f_b.shape[1:] or omega_b.shape[-1] != 3 or omega_b.shape[1] < 1:
        raise ValueError(f"samples must be (runs, N, 3) with N >= 1; got omega_b {omega_b.shape} and f_b {f_b.shape}")
    if not dt > 0.0:
        raise ValueError(f"dt must be positive; got {dt}")
    runs, count = max(len(omega_b), len(f_b)), omega_b.shape[1]
    block = max(1, _BLOCK_SAMPLES // count)
    if runs <= block:
        sums = _fast(omega_b, f_b, dt)
    else:
        omega_b, f_b = np.broadcast_to(omega_b, (runs, count, 3)), np.broadcast_to(f_b, (runs, count, 3))
        blocks = [_fast(omega_b[i : i + block], f_b[i : i + block], dt) for i in range(0, runs, block)]
        sums = np.concatenate(blocks, axis=1)
    return _slow(state, sums, (count + 1) // 2 * dt, count * dt)


@lru_cache(maxsize=64)
def _change_stencil(count: int) -> Array:
    """Matrix (count, count) that takes sample means to what their change contributes to coning and sculling.

    With omega = a + b t + c t^2 + d t^3 about the middle of a sample of unit length and alpha its integral, half the
    integral of alpha x omega is a x (b / 12 + d / 80), less b x c / 240, left out. Each row fits the polynomial to the
    means of the five nearest samples, off-centre at the ends of the interval, fewer if there are no five.
    """
    width = min(5, count)
    stencil = np.zeros((count, count))
    powers = np.arange(width + 1)
    for i in range(count):
        start = min(max(i - width // 2, 0), count - width)
        edges = np.arange(start, start + width + 1)[:, None] - (i + 0.5)
        means = np.diff(edges ** powers[1:], axis=0) / powers[1:]
        wanted = np.zeros(width)
        wanted[1:2], wanted[3:4] = 1.0 / 12.0, 1.0 / 80.0
        stencil[i, start : start + width] = np.linalg.solve(means.T, wanted)
    return stencil


# Where the entries of a cross-product matrix plus diagonal come from: 0-2 the vector, 3-5 its negative, 6 the diagonal.
_ENTRIES = np.array([[6, 5, 1], [2, 6, 3], [4, 0, 6]])
_EYE5 = np.eye(5)


def _fast(omega_b: Array, f_b: Array, dt: float) -> Array:
    """Body-frame recursion: matrices (2, runs, 5, 5) of the first half, rounded up to a sample, and of the whole.

    Arrays here lead with the component and end with the samples, so that each operation runs over contiguous numbers.
    Components are stored as x, y, z, x, y: both terms of a cross product are then slices.
    """
    runs, count = max(len(omega_b), len(f_b)), omega_b.shape[1]
    increments = np.empty((2, 3, runs, count))
    np.multiply(omega_b.transpose(2, 0, 1), dt, out=increments[0])
    np.multiply(f_b.transpose(2, 0, 1), dt, out=increments[1])
    x = np.empty((2, 5, runs, count))
    x[:, :3], x[:, 3:] = increments, increments[:, :2]
    theta, v = increments
    # Right-hand sides of the cross products: change of angle, change of velocity, velocity.
    y = np.empty((3, 5, runs, count))
    y[:2, :3] = (increments.reshape(-1, count) @ _change_stencil(count).T).reshape(increments.shape)
    y[:2, 3:] = y[:2, :2]
    y[2] = x[1]
    theta_x = x[0, 1:4] * y[:, 2:] - x[0, 2:] * y[:, 1:4]
    coning, rotation = theta_x[0], theta_x[2]
    sculling = theta_x[1] + x[1, 1:4] * y[0, 2:] - x[1, 2:] * y[0, 1:4]

    phi = theta + coning
    phi_squared = np.add.reduce(phi * phi, axis=0)
    a, b, c = rotation_coefficients(phi_squared)
    b_phi = b * phi

    # An odd count is padded with one sample of no duration: it changes nothing and lets both halves run as one batch.
    half = (count + 1) // 2
    m = np.empty((runs, 2 * half, 5, 5))
    m[:, :, 3:] = _EYE5[3:]
    m[:, :count, 3, 4] = dt
    if count % 2:
        m[:, -1] = _EYE5
    top = np.empty((3, 5, runs, count))
    entries = np.empty((7, runs, count))
    np.multiply(a, phi, out=entries[:3])
    np.negative(entries[:3], out=entries[3:6])
    np.subtract(1.0, b * phi_squared, out=entries[6])
    np.multiply(b_phi[:, None], phi, out=top[:, :3])
    top[:, :3] += entries.take(_ENTRIES, axis=0)
    # Velocity: rotation to all orders (the integral of Rodrigues' formula, theta x (theta x v) written out), sculling.
    dv = v * (1.0 - c * phi_squared)
    dv += b * rotation
    dv += (c * np.add.reduce(theta * v, axis=0)) * theta
    dv += sculling
    top[:, 3] = dv
    # Position: mid-sample rule, then scrolling.
    top[:, 4] = (0.5 * dt) * dv - (dt / 12.0) * rotation - (0.5 * dt) * y[1, :3]
    m[:, :count, :3] = top.transpose(2, 3, 0, 1)

    halves = ordered_product(m.reshape(runs, 2, half, 5, 5))
    out = np.empty((2, runs, 5, 5))
    out[0] = halves[:, 0]
    np.matmul(halves[:, 0], halves[:, 1], out=out[1])
    return out


# A component of a vector: a float when there is one run, else an array (runs,). One run is what a person watches, and
# Python's floats are ten times faster there than arrays of length one; the formulas are the same text for both.
Component: TypeAlias = Any
Vector: TypeAlias = Sequence[Component]
_XYZ: Final = (0, 1, 2)


def components(columns: Array) -> tuple[Any, list[Component]]:
    """Rows of ``columns`` (n, runs) as components, and the module, ``math`` or ``numpy``, whose functions take them."""
    if columns.shape[1] == 1:
        floats = columns[:, 0].tolist()
        # An absurd (infinite) reading becomes nan in numpy; math would raise.
        if all(map(math.isfinite, floats)):
            return math, floats
    return np, list(columns)


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@lru_cache(maxsize=64)
def _quadrature(alpha: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Weights on nodes 0, alpha, 1 for the integral, and for the double integral, over the unit interval.

    Exact for parabolas (Simpson's rule at alpha = 1/2); alpha = 1 leaves two nodes, exact for straight lines.
    """
    if alpha == 1.0:
        return (0.5, 0.0, 0.5), (1.0 / 3.0, 0.0, 1.0 / 6.0)
    single, double = 1.0 / (6.0 * alpha * (1.0 - alpha)), 1.0 / (12.0 * alpha * (1.0 - alpha))
    end, double_end = 0.5 - single * alpha, 1.0 / 6.0 - double * alpha
    return (1.0 - single - end, single, end), (0.5 - double - double_end, double, double_end)


def _slow_terms(fn: Any, lat: Component, height: Component, v: Vector) -> tuple[Vector, Vector, Vector]:
    """Slow terms at one instant: rotation rate of n in inertial space; Coriolis and gravity; radians per metre.

    ``fn`` is ``math`` or ``numpy``. The last vector is (longitude per metre east, latitude per metre north, 1). These
    are the formulas of :mod:`ftcore.earth` sharing one sine, cosine and root.
    """
    sin_lat, cos_lat = fn.sin(lat), fn.cos(lat)
    s2 = sin_lat * sin_lat
    w2 = 1.0 - earth.E2 * s2
    root = fn.sqrt(w2)
    r_n = earth.A / root
    east, north = 1.0 / (r_n + height), 1.0 / (r_n * ((1.0 - earth.E2) / w2) + height)
    x = height * (1.0 / earth.A)
    gravity = earth.GRAVITY_EQUATOR * (1.0 + earth.SOMIGLIANA * s2) / root
    gravity = gravity * (1.0 + x * (3.0 * x - 2.0 * (earth.GRAVITY_SLOPE - 2.0 * earth.F * s2)))

    earth_n, earth_u = earth.RATE * cos_lat, earth.RATE * sin_lat
    transport_n = v[0] * east
    omega = (-v[1] * north, transport_n + earth_n, transport_n * (sin_lat / cos_lat) + earth_u)
    coriolis = _cross(v, (omega[0], omega[1] + earth_n, omega[2] + earth_u))
    return omega, (coriolis[0], coriolis[1], coriolis[2] - gravity), (east / cos_lat, north, 1.0)


def _level_turn(p: Vector) -> list[Component]:
    """Nine entries, row by row, of the rotation by the small vector 2 p (Cayley: orthogonal, exact to p^3)."""
    x, y, z = p
    xx, yy, zz = x * x, y * y, z * z
    k = 2.0 / (1.0 + xx + yy + zz)
    xy, xz, yz = x * y, x * z, y * z
    return [
        *(1.0 - k * (yy + zz), k * (xy - z), k * (xz + y)),
        *(k * (xy + z), 1.0 - k * (xx + zz), k * (yz - x)),
        *(k * (xz - y), k * (yz + x), 1.0 - k * (xx + yy)),
    ]


def _slow(state: InsState, sums: Array, h1: float, time: float) -> tuple[InsState, Interval]:
    """Navigation-frame recursion over one interval of ``time`` seconds whose middle node is at ``h1``."""
    # Middle and end as seen from the level frame of the start: (2, runs, 3, 5).
    seen = state.C_nb @ sums[..., :3, :]
    runs = max(seen.shape[1], state.lla.shape[0], state.v_n.shape[0])
    columns = np.empty((18, runs))
    columns[0:3] = state.lla.T
    columns[3:6] = state.v_n.T
    columns[6:18] = seen[..., 3:].transpose(0, 3, 2, 1).reshape(12, -1)
    fn, c = components(columns)
    v0, dv_mid, dp_mid, dv, dp = c[3:6], c[6:9], c[9:12], c[12:15], c[15:18]
    omega0, slow0, per_metre0 = _slow_terms(fn, c[0], c[2], v0)

    def predict(t: float, dv: Vector, dp: Vector) -> tuple[Vector, Vector, Vector]:
        # The level frame turned under dv: left out here, it would drift the level at rest by 1e-4 m/s.
        turned = _cross(omega0, dv)
        v = [v0[i] + dv[i] + t * (slow0[i] - 0.5 * turned[i]) for i in _XYZ]
        moved = [t * v0[i] + dp[i] + (0.5 * t * t) * slow0[i] for i in _XYZ]
        return _slow_terms(fn, c[0] + moved[1] * per_metre0[1], c[2] + moved[2], v)

    omega_mid, slow_mid, per_metre_mid = predict(h1, dv_mid, dp_mid)
    omega1, slow1, per_metre1 = predict(time, dv, dp)
    (a0, am, a1), (b0, bm, b1) = _quadrature(h1 / time)
    zeta = [time * (a0 * omega0[i] + am * omega_mid[i] + a1 * omega1[i]) for i in _XYZ]

    # Specific force was summed in the level frame frozen at the start; the real one turns away from it meanwhile.
    h2 = time - h1
    turned = _cross([0.5 * (omega0[i] + omega_mid[i]) for i in _XYZ], [h1 * dv[i] - dp_mid[i] for i in _XYZ])
    turned_late = _cross(
        [0.5 * (omega_mid[i] + omega1[i]) for i in _XYZ], [h2 * dv[i] - (dp[i] - dp_mid[i]) for i in _XYZ]
    )
    turned = [turned[i] + turned_late[i] for i in _XYZ]
    turned_twice = _cross(zeta, turned)
    turned_path = _cross(zeta, dp)
    f_time = [dv[i] - turned[i] + turned_twice[i] * (1.0 / 3.0) for i in _XYZ]
    v1 = [v0[i] + f_time[i] + time * (a0 * slow0[i] + am * slow_mid[i] + a1 * slow1[i]) for i in _XYZ]
    path = [
        time * v0[i]
        + (dp[i] - turned_path[i] * (1.0 / 3.0))
        + (time * time) * (b0 * slow0[i] + bm * slow_mid[i] + b1 * slow1[i])
        for i in _XYZ
    ]
    # Angle is the integral of velocity times curvature. Both vary: the covariance of two straight lines is 1/12.
    lon, lat, height = (
        path[i] * (a0 * per_metre0[i] + am * per_metre_mid[i] + a1 * per_metre1[i])
        + (time / 12.0) * (v1[i] - v0[i]) * (per_metre1[i] - per_metre0[i])
        for i in _XYZ
    )
    rows = [c[0] + lat, c[1] + lon, c[2] + height, *v1, *_level_turn([-0.5 * z for z in zeta])]
    rows += [c[0] + 0.5 * lat, c[1] + 0.5 * lon, c[2] + 0.5 * height, *(p / time for p in path)]
    rows += [f / time for f in f_time]
    out = np.array(rows).reshape(24, runs).T

    # At the middle the turn of the level frame, 1e-4 rad, is left out: the nodes serve an error model.
    C_nb = np.empty((3, runs, 3, 3))
    C_nb[0], C_nb[1] = state.C_nb, seen[0, ..., :3]
    np.matmul(out[:, 6:15].reshape(runs, 3, 3), seen[1, ..., :3], out=C_nb[2])
    mean_C = a0 * C_nb[0] + am * C_nb[1] + a1 * C_nb[2]
    interval = Interval(time, out[:, 15:18], out[:, 18:21], out[:, 21:24], mean_C, C_nb, (a0, am, a1))
    return InsState(_wrapped(out[:, :3]), out[:, 3:6], C_nb[2]), interval


def _wrapped(lla: Array) -> Array:
    """The same positions with longitude in [-pi, pi]; almost always the same array."""
    if np.abs(lla[:, 1]).max() > np.pi:
        lla = lla - 2.0 * np.pi * np.round(lla[:, 1:2] / (2.0 * np.pi)) * np.array([0.0, 1.0, 0.0])
    return lla


def damping_gains(time_constant: float = DEFAULT_DAMPING_TIME, height: float = 0.0) -> tuple[float, float]:
    """Gains ``(k1 [1/s], k2 [1/s^2])`` that make the baro-aided vertical channel critically damped.

    The free channel diverges as s^2 = 2 g / r; with the gains it is (s + 1/T)^2 with T = ``time_constant`` seconds.

    Raises:
        ValueError: the time constant is not positive.
    """
    if not time_constant > 0.0:
        raise ValueError(f"time constant must be positive; got {time_constant} s")
    pull = -float(earth.gravity_gradient(np.pi / 4.0, height)[1])
    return 2.0 / time_constant, 1.0 / time_constant**2 + pull


def damp_vertical(state: InsState, barometric_height: ArrayLike, dt: float, k1: ArrayLike, k2: ArrayLike) -> InsState:
    """Pull height and vertical velocity towards the altimeter, once an epoch of ``dt`` seconds.

    ``h -= k1 dt (h - h_baro)``, ``v_up -= k2 dt (h - h_baro)``, with ``barometric_height`` (runs,) m. The gains may be
    (runs,) arrays; zero where the altimeter is out.
    """
    step = dt * (state.lla[..., 2] - np.asarray(barometric_height))
    position, velocity = np.zeros((*step.shape, 3)), np.zeros((*step.shape, 3))
    position[..., 2] = k1 * step
    velocity[..., 2] = k2 * step
    return replace(state, lla=state.lla - position, v_n=state.v_n - velocity)
