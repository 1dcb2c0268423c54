"""Error model of a strapdown INS damped by an altimeter and aided by GPS and Doppler: 21 states (Zhang 1992, eq. 58).

Conventions of :mod:`ftcore.earth`; error = indicated - true. Runs lead: states (runs, 21), matrices (runs, 21, 21).

====== ================================ ====== ==========================================================
slice  state                            unit   meaning
====== ================================ ====== ==========================================================
0-2    position error east, north, up   m      r_E = dlon (R_N + h) cos lat, r_N = dlat (R_M + h), dh
3-5    velocity error east, north, up   m/s    component by component, in the level frame of its own place
6-8    attitude error east, north, up   rad    rotation vector phi: C_nb indicated = exp([phi x]) C_nb true
9-11   gyro drift, body axes            rad/s  added to the reading
12-14  accelerometer bias, body axes    m/s^2  added to the reading
15     altimeter bias E_po              m      barometric height - height = E_po + E_hsf height
16     altimeter scale error E_hsf      1
17     Doppler scale error d_k          1
18     Doppler drift angle d_Delta      rad
19     clock phase d_tu                 m      times c
20     clock frequency d_tru            m/s    times c
====== ================================ ====== ==========================================================

The paper carries longitude and latitude errors in radians; metres condition the covariance better and are the same
states. A positive phi_up turns the indicated body axes anticlockwise seen from above: the indicated *heading* is too
small by it. The paper gives F in a reference not at hand; here it is derived by perturbing the strapdown equations of
:mod:`ftcore.estimation.strapdown` (Groves ch. 14.2 does the same in north-east-down), and tested against them.

The first 15 states are an INS model of their own: :func:`core_matrix`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftcore import earth
from ftcore.estimation.kalman import identity
from ftcore.estimation.strapdown import Component, InsState, Interval, components
from ftcore.rotation import matrix_to_rotvec, rotvec_to_matrix

Array = NDArray[np.float64]

STATE_NAMES: Final = (
    "position.east",
    "position.north",
    "position.up",
    "velocity.east",
    "velocity.north",
    "velocity.up",
    "attitude.east",
    "attitude.north",
    "attitude.azimuth",
    "gyro.x",
    "gyro.y",
    "gyro.z",
    "accelerometer.x",
    "accelerometer.y",
    "accelerometer.z",
    "altimeter.bias",
    "altimeter.scale",
    "doppler.scale",
    "doppler.drift_angle",
    "clock.phase",
    "clock.frequency",
)
STATES: Final = len(STATE_NAMES)
CORE_STATES: Final = 15
"""Position, velocity, attitude, gyro drift, accelerometer bias: the part that any INS has."""

POSITION: Final = slice(0, 3)
VELOCITY: Final = slice(3, 6)
ATTITUDE: Final = slice(6, 9)
GYRO: Final = slice(9, 12)
ACCELEROMETER: Final = slice(12, 15)
ALTIMETER_BIAS: Final = 15
ALTIMETER_SCALE: Final = 16
DOPPLER_SCALE: Final = 17
DOPPLER_DRIFT: Final = 18
CLOCK_PHASE: Final = 19
CLOCK_FREQUENCY: Final = 20
CLOCK: Final = slice(19, 21)

_EYE: Final = np.eye(STATES)


def core_matrix(lla: Array, v_n: Array, f_n: Array, C_nb: Array, size: int = CORE_STATES) -> Array:
    """Matrix F of d/dt x = F x for position, velocity, attitude, gyro drift and accelerometer bias.

    ``lla``, ``v_n`` [m/s], ``f_n`` [m/s^2] (runs, 3) and ``C_nb`` (runs, 3, 3), means over the interval. Returns
    (runs, size, size) with the 15 states first and zeros in the rest. Biases are constants; a model that wants them to
    decay adds its -1/tau on the diagonal.
    """
    runs = max(len(lla), len(v_n), len(f_n), len(C_nb))
    columns = np.empty((9, runs))
    columns[0:3], columns[3:6], columns[6:9] = lla.T, v_n.T, f_n.T
    fn, c = components(columns)
    lat, _, height, v_e, v_no, v_u, f_e, f_no, f_u = c
    sin_lat, cos_lat = fn.sin(lat), fn.cos(lat)
    tan_lat = sin_lat / cos_lat
    s2 = sin_lat * sin_lat
    w2 = 1.0 - earth.E2 * s2
    r_n = earth.A / fn.sqrt(w2)
    east, north = 1.0 / (r_n + height), 1.0 / (r_n * ((1.0 - earth.E2) / w2) + height)
    # Gravity's change with height and with metres north, to the leading term of each.
    g_height = (-2.0 / earth.A * earth.GRAVITY_EQUATOR) * (1.0 + earth.SOMIGLIANA * s2)
    g_north = (2.0 * earth.GRAVITY_EQUATOR * (earth.SOMIGLIANA + 0.5 * earth.E2)) * sin_lat * cos_lat * north

    # Rotation rates of the level frame: Earth (ie), transport (t), their sum (w) and Coriolis (c).
    ie_n, ie_u = earth.RATE * cos_lat, earth.RATE * sin_lat
    t_e, t_n = -v_no * north, v_e * east
    t_u = t_n * tan_lat
    w_n, w_u = ie_n + t_n, ie_u + t_u
    c_n, c_u = ie_n + w_n, ie_u + w_u
    # Their derivatives: with metres north (d), with height (h).
    ie_n_d, ie_u_d = -ie_u * north, ie_n * north
    t_u_d = t_n * north / (cos_lat * cos_lat)
    c_u_d = 2.0 * ie_u_d + t_u_d
    t_e_h, t_n_h, t_u_h = -t_e * north, -t_n * east, -t_u * east

    entries: tuple[tuple[int, int, Component], ...] = (
        # Position: in metres, the derivatives of the radii with latitude cancel exactly.
        (0, 0, (v_u - v_no * tan_lat) * east),
        (0, 1, t_u),
        (0, 2, -t_n),
        (1, 1, v_u * north),
        (1, 2, t_e),
        # Velocity, by position: v x (2 d omega_ie + d omega_en) and gravity.
        (3, 1, v_no * c_u_d - 2.0 * v_u * ie_n_d),
        (4, 1, -v_e * c_u_d),
        (5, 1, 2.0 * v_e * ie_n_d - g_north),
        (3, 2, v_no * t_u_h - v_u * t_n_h),
        (4, 2, v_u * t_e_h - v_e * t_u_h),
        (5, 2, v_e * t_n_h - v_no * t_e_h - g_height),
        # By velocity: -(2 omega_ie + omega_en) x dv, and v x (d omega_en by dv).
        (3, 3, (v_no * tan_lat - v_u) * east),
        (3, 4, c_u),
        (3, 5, -c_n),
        (4, 3, -c_u - v_e * tan_lat * east),
        (4, 4, -v_u * north),
        (4, 5, t_e),
        (5, 3, c_n + v_e * east),
        (5, 4, -t_e + v_no * north),
        # By attitude: phi x f.
        (3, 7, f_u),
        (3, 8, -f_no),
        (4, 6, -f_u),
        (4, 8, f_e),
        (5, 6, f_no),
        (5, 7, -f_e),
        # Attitude: -d omega_in by position and velocity, and -omega_in x phi.
        (7, 1, -ie_n_d),
        (8, 1, -ie_u_d - t_u_d),
        (6, 2, -t_e_h),
        (7, 2, -t_n_h),
        (8, 2, -t_u_h),
        (6, 4, north),
        (7, 3, -east),
        (8, 3, -east * tan_lat),
        (6, 7, w_u),
        (6, 8, -w_n),
        (7, 6, -w_u),
        (7, 8, t_e),
        (8, 6, w_n),
        (8, 7, -t_e),
    )
    F = np.zeros((runs, size, size))
    F.reshape(runs, -1)[:, [row * size + column for row, column, _ in entries]] = (
        np.array([value for _, _, value in entries]).reshape(len(entries), runs).T
    )
    F[:, 0, 3] = F[:, 1, 4] = F[:, 2, 5] = 1.0
    F[:, 3:6, 12:15] = C_nb
    F[:, 6:9, 9:12] = C_nb
    return F


def system_matrix(interval: Interval) -> Array:
    """Matrix F (runs, 21, 21) of d/dt x = F x over an interval that the strapdown just integrated.

    The altimeter enters through :func:`damping_transition`, once an epoch, as it does in the strapdown.
    """
    F = core_matrix(interval.lla, interval.v_n, interval.f_n, interval.C_nb, STATES)
    F[..., CLOCK_PHASE, CLOCK_FREQUENCY] = 1.0
    return F


# Larger batches are done in blocks of runs: temporaries of more than this come fresh from the operating system on every
# call, and their page faults cost more than the arithmetic.
_BLOCK_RUNS: Final = 32


def _in_blocks(kernel: Callable[..., Array], dt: float, *matrices: Array) -> Array:
    """``kernel(*matrices, dt)`` for matrices (..., n, n), a block of runs at a time."""
    shape = np.broadcast_shapes(*(m.shape for m in matrices))
    if len(shape) != 3 or shape[0] <= _BLOCK_RUNS:
        return kernel(*matrices, dt)
    out = np.empty(shape)
    for start in range(0, shape[0], _BLOCK_RUNS):
        block = slice(start, start + _BLOCK_RUNS)
        out[block] = kernel(*(m if m.ndim < 3 or len(m) == 1 else m[block] for m in matrices), dt)
    return out


def transition(F: Array, dt: float) -> Array:
    """exp(F dt) to third order, for any square F (..., n, n); dt seconds."""
    return _in_blocks(_transition, dt, F)


def _transition(F: Array, dt: float) -> Array:
    eye = identity(F.shape[-1])
    M = F * dt
    Phi = M * (1.0 / 3.0)
    Phi += eye
    Phi = M @ Phi
    Phi *= 0.5
    Phi += eye
    Phi = M @ Phi
    Phi += eye
    return Phi


def damping_transition(height: ArrayLike, dt: float, k1: ArrayLike, k2: ArrayLike) -> Array:
    """What :func:`~ftcore.estimation.strapdown.damp_vertical` does to the errors: matrix D (..., 21, 21), exact.

    ``height`` (...) m is the indicated one; gains as given to ``damp_vertical``. An epoch's transition is D Phi.
    """
    height, k1, k2 = np.asarray(height, dtype=np.float64), np.asarray(k1), np.asarray(k2)
    D = np.zeros((*np.broadcast_shapes(height.shape, k1.shape, k2.shape), STATES, STATES))
    D[...] = _EYE
    for row, gain in ((2, k1 * dt), (5, k2 * dt)):
        D[..., row, 2] -= gain
        D[..., row, ALTIMETER_BIAS] = gain
        D[..., row, ALTIMETER_SCALE] = gain * height
    return D


def damping_noise(dt: float, k1: ArrayLike, k2: ArrayLike, sigma: ArrayLike) -> Array:
    """Covariance (..., 21, 21) that white altimeter noise of ``sigma`` m an epoch adds through the damping.

    It comes after D: P = D (Phi P Phi' + Q) D' + this.
    """
    k1, k2, sigma = np.asarray(k1), np.asarray(k2), np.asarray(sigma)
    d = np.zeros((*np.broadcast_shapes(k1.shape, k2.shape, sigma.shape), STATES))
    d[..., 2] = k1 * dt * sigma
    d[..., 5] = k2 * dt * sigma
    return d[..., :, None] * d[..., None, :]


@dataclass(frozen=True, slots=True)
class NoiseDensities:
    """White noise that drives the model: spectral densities, that is variance per second.

    ``gyro`` rad^2/s and ``accelerometer`` (m/s^2)^2 s are the squares of angle and velocity random walk: a number, or
    (..., 3, 3) in the body frame, since a redundant IMU that lost an instrument is noisier along some axes.
    ``clock_phase`` m^2/s and ``clock_frequency`` m^2/s^3 are S_f and S_g of the two-state clock. The rest are random
    walks of what is otherwise constant: gyro drift (rad/s)^2/s, accelerometer bias (m/s^2)^2/s, altimeter bias m^2/s,
    altimeter and Doppler scale 1/s, Doppler angle rad^2/s. Numbers may be arrays (runs,).
    """

    gyro: ArrayLike
    accelerometer: ArrayLike
    clock_phase: ArrayLike = 0.0
    clock_frequency: ArrayLike = 0.0
    gyro_walk: ArrayLike = 0.0
    accelerometer_walk: ArrayLike = 0.0
    altimeter_bias_walk: ArrayLike = 0.0
    altimeter_scale_walk: ArrayLike = 0.0
    doppler_scale_walk: ArrayLike = 0.0
    doppler_drift_walk: ArrayLike = 0.0


_WALKS: Final = (
    ("gyro_walk", (9, 10, 11)),
    ("accelerometer_walk", (12, 13, 14)),
    ("altimeter_bias_walk", (ALTIMETER_BIAS,)),
    ("altimeter_scale_walk", (ALTIMETER_SCALE,)),
    ("doppler_scale_walk", (DOPPLER_SCALE,)),
    ("doppler_drift_walk", (DOPPLER_DRIFT,)),
    ("clock_phase", (CLOCK_PHASE,)),
    ("clock_frequency", (CLOCK_FREQUENCY,)),
)


def noise_density(attitude: Interval | Array, densities: NoiseDensities) -> Array:
    """Spectral density matrix (runs, 21, 21) of the noise on d/dt x.

    ``attitude`` turns body axes to level: an interval, whose changing attitude is then averaged over, or one ``C_nb``
    (runs, 3, 3). It matters only where axes differ.
    """
    gyro, accelerometer = _in_level(densities.gyro, attitude), _in_level(densities.accelerometer, attitude)
    walks = [np.asarray(getattr(densities, name)) for name, _ in _WALKS]
    C_nb = attitude.C_nb if isinstance(attitude, Interval) else attitude
    runs = np.broadcast_shapes(C_nb.shape[:-2], gyro.shape[:-2], accelerometer.shape[:-2], *(w.shape for w in walks))
    Qc = np.zeros((*runs, STATES, STATES))
    Qc[..., VELOCITY, VELOCITY] = accelerometer
    Qc[..., ATTITUDE, ATTITUDE] = gyro
    for walk, (_, states) in zip(walks, _WALKS, strict=True):
        for i in states:
            Qc[..., i, i] = walk
    return Qc


def _in_level(density: ArrayLike, attitude: Interval | Array) -> Array:
    density = np.asarray(density, dtype=np.float64)
    if density.ndim < 2:  # equal along all axes: it looks the same from any frame
        return np.asarray(density[..., None, None] * np.eye(3))
    if not isinstance(attitude, Interval):
        return np.asarray(attitude @ density @ np.swapaxes(attitude, -1, -2))
    start, middle, end = attitude.C_nb_nodes @ density @ np.swapaxes(attitude.C_nb_nodes, -1, -2)
    a0, am, a1 = attitude.node_weights
    return np.asarray(a0 * start + am * middle + a1 * end)


def process_noise(F: Array, Qc: Array, dt: float) -> Array:
    """Covariance (..., n, n) that noise of spectral density ``Qc`` builds up in ``dt`` seconds of d/dt x = F x + w.

    The integral of Phi(t) Qc Phi(t)', Phi to second order, by Gauss's rule on two points: exact up to t^3, hence exact
    for the clock pair and for a double integrator, and positive semidefinite whatever F is. Any square size.
    """
    return _in_blocks(_process_noise, dt, F, Qc)


def _process_noise(F: Array, Qc: Array, dt: float) -> Array:
    middle, spread = 0.5 * dt, dt * (math.sqrt(3.0) / 6.0)
    eye = identity(F.shape[-1])
    F2 = F @ F
    # Phi at the points middle -+ spread is even -+ odd, and so the sum of both quadratic forms is that of these two.
    even = F2 * (0.5 * (middle * middle + spread * spread))
    even += middle * F
    even += eye
    odd = F2 * (middle * spread)
    odd += spread * F
    Q = even @ Qc @ np.swapaxes(even, -1, -2)
    Q += odd @ Qc @ np.swapaxes(odd, -1, -2)
    Q *= dt
    return np.asarray(Q)


def correct(ins: InsState, x: Array) -> InsState:
    """The indicated state minus estimated errors ``x`` (runs, 9 or more); the sensor errors in x are not touched.

    ``navigation_error(ins, correct(ins, x))`` is ``x[:, :9]`` again.
    """
    lat = ins.lla[..., 0]
    r_m, r_n = earth.principal_radii(lat)
    height = ins.lla[..., 2]
    shift = np.stack([x[..., 1] / (r_m + height), x[..., 0] / ((r_n + height) * np.cos(lat)), x[..., 2]], axis=-1)
    return InsState(ins.lla - shift, ins.v_n - x[..., VELOCITY], rotvec_to_matrix(-x[..., ATTITUDE]) @ ins.C_nb)


def navigation_error(indicated: InsState, true: InsState) -> Array:
    """Errors of an indicated state in the units of the first nine states, (runs, 9); finite, not linearised."""
    lat, height = indicated.lla[..., 0], indicated.lla[..., 2]
    r_m, r_n = earth.principal_radii(lat)
    d = indicated.lla - true.lla
    d_lon = d[..., 1] - 2.0 * np.pi * np.round(d[..., 1] / (2.0 * np.pi))
    error = np.empty((*d_lon.shape, 9))
    error[..., 0] = d_lon * (r_n + height) * np.cos(lat)
    error[..., 1] = d[..., 0] * (r_m + height)
    error[..., 2] = d[..., 2]
    error[..., VELOCITY] = indicated.v_n - true.v_n
    error[..., ATTITUDE] = matrix_to_rotvec(indicated.C_nb @ np.swapaxes(true.C_nb, -1, -2))
    return error
