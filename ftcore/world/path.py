"""A flight along piecewise polynomials, evaluated block by block: where it is, and what a perfect IMU on it measures.

From vertical speed, speed and heading as polynomials of time follow attitude, angular rate and specific force in closed
form (nose along the velocity, bank of a coordinated turn), and position by sixth-order quadrature. The IMU signal is
the mean of angular rate and specific force over each sample interval, by Gauss-Legendre quadrature of the closed forms:
it knows nothing of the algorithm that will integrate it.

Nothing is made before it is asked for. A block is a pure function of its number; only its first latitude and longitude
follow from the blocks before, and these four numbers a block are kept.

Truth is common to all runs, so these arrays lead with time, without a run axis. Conventions of :mod:`ftcore.earth`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from ftcore import earth
from ftcore.rotation import cross, rpy_to_matrix

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trajectory:
    """Truth at the IMU's step.

    At the N + 1 instants ``time`` [s]: ``lla`` (N+1, 3), ``v_n`` (N+1, 3) m/s, ``rpy`` (N+1, 3) roll, pitch, heading
    [rad], ``C_nb`` (N+1, 3, 3). Over the N intervals of ``dt`` seconds between them: ``omega_b`` (N, 3) rad/s and
    ``f_b`` (N, 3) m/s^2, mean angular rate and mean specific force in the body frame. Arrays are read-only.
    """

    dt: float
    time: Array
    lla: Array
    v_n: Array
    rpy: Array
    omega_b: Array
    f_b: Array

    def __post_init__(self) -> None:
        for array in (self.time, self.lla, self.v_n, self.rpy, self.omega_b, self.f_b):
            array.setflags(write=False)

    @cached_property
    def C_nb(self) -> Array:
        """True body-to-level matrices (N+1, 3, 3), made when first asked for."""
        C_nb = rpy_to_matrix(self.rpy)
        C_nb.setflags(write=False)
        return C_nb

    @property
    def samples(self) -> int:
        """Number N of IMU intervals."""
        return len(self.omega_b)

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.samples * self.dt

    def cut(self, start: int, end: int) -> Trajectory:
        """From instant `start` to instant `end`: views, not copies."""
        instants, samples = slice(start, end + 1), slice(start, end)
        return Trajectory(
            self.dt,
            *(array[instants] for array in (self.time, self.lla, self.v_n, self.rpy)),
            *(array[samples] for array in (self.omega_b, self.f_b)),
        )


# Gauss-Legendre points on [0, 1], their weights, and the integrals of the interpolant from 0 to each point: the Gauss
# collocation method of order six.
_ROOT15 = math.sqrt(15.0)
_POINTS = np.array([0.5 - _ROOT15 / 10.0, 0.5, 0.5 + _ROOT15 / 10.0])
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
_TO_POINT = np.array(
    [
        [5.0 / 36.0, 2.0 / 9.0 - _ROOT15 / 15.0, 5.0 / 36.0 - _ROOT15 / 30.0],
        [5.0 / 36.0 + _ROOT15 / 24.0, 2.0 / 9.0, 5.0 / 36.0 - _ROOT15 / 24.0],
        [5.0 / 36.0 + _ROOT15 / 30.0, 2.0 / 9.0 + _ROOT15 / 15.0, 5.0 / 36.0],
    ]
)
_BLOCK: Final = 5000
"""Samples that are evaluated together."""
_SUMMED: Final = 50_000
"""Samples after which the sums behind latitude and longitude start anew; a multiple of a block."""
_COARSE: Final = 1.0
"""Seconds of the steps in which a flight is looked through before it begins."""
_CARE: Final = 1e-4
"""How much further from the poles a coarse path must stay [rad]: some hundred times its error."""
_HIGHEST_LATITUDE: Final = math.radians(89.0)


@dataclass(frozen=True)
class _Motion:
    """Velocity and attitude (roll, pitch, heading) with their derivatives, at times of any shape."""

    v_n: Array
    a_n: Array
    rpy: Array
    rpy_rate: Array


def _motion(polynomials: tuple[PPoly, PPoly, PPoly], t: Array) -> _Motion:
    """Closed forms at times ``t``: nose along the velocity, bank of a coordinated turn."""
    vertical, speed, heading = polynomials
    u, du = vertical(t), vertical(t, 1)
    V, dV = speed(t), speed(t, 1)
    psi, dpsi, ddpsi = heading(t), heading(t, 1), heading(t, 2)

    # Speed is along the path: across the ground goes what the climb leaves of it.
    across = np.sqrt(V * V - u * u)
    moving = across > 0.0
    d_across = np.where(moving, (V * dV - u * du) / np.where(moving, across, 1.0), dV)
    s, c = np.sin(psi), np.cos(psi)
    v_n = np.stack([across * s, across * c, u], axis=-1)
    a_n = np.stack([d_across * s + across * dpsi * c, d_across * c - across * dpsi * s, du], axis=-1)

    d_pitch = np.where(moving, (across * du - u * d_across) / np.where(moving, V * V, 1.0), 0.0)
    lean = V * dpsi / earth.STANDARD_GRAVITY
    d_lean = (dV * dpsi + V * ddpsi) / earth.STANDARD_GRAVITY
    rpy = np.stack([np.arctan(lean), np.arctan2(u, across), psi], axis=-1)
    rpy_rate = np.stack([d_lean / (1.0 + lean * lean), d_pitch, dpsi], axis=-1)
    return _Motion(v_n, a_n, rpy, rpy_rate)


@dataclass(frozen=True)
class _Sum:
    """An angle integrated so far: ``start + total dt``. The total goes on from block to block, so that blocks of any
    size add the same numbers in the same order."""

    start: float
    total: float = 0.0

    def renewed(self, dt: float) -> _Sum:
        """The same angle with nothing summed yet."""
        return _Sum(self.start + self.total * dt)


def _integrate(rate: Array, so_far: _Sum, dt: float) -> tuple[Array, Array, _Sum]:
    """Integral of a rate given at the points (n, 3): at the points (n, 3), at the end of each sample (n,), and on."""
    totals = np.cumsum(np.concatenate([[so_far.total], rate @ _WEIGHTS]))
    ends = so_far.start + totals * dt
    return ends[:-1, None] + (rate @ _TO_POINT.T) * dt, ends[1:], _Sum(so_far.start, float(totals[-1]))


def _positions(
    v_n: Array, height: Array, mark: tuple[_Sum, _Sum], dt: float, highest: float
) -> tuple[Array, Array, Array, tuple[_Sum, _Sum]]:
    """Latitude at the points (n, 3), latitude and longitude at the end of each sample (n,), and where they stand then.

    ``v_n`` (n, 3, 3) and ``height`` (n, 3) are at the points. The latitude's own effect on the meridian radius is
    solved by fixed-point iteration: it converges a hundredfold a turn. Raises ValueError beyond a latitude `highest`.
    """
    lat = np.full(height.shape, mark[0].start + mark[0].total * dt)
    for _ in range(20):
        r_m, _ = earth.principal_radii(lat)
        previous = lat
        lat, lat_ends, latitude = _integrate(v_n[..., 1] / (r_m + height), mark[0], dt)
        if not np.abs(lat).max() < highest:
            raise ValueError("the flight comes within 1 degree of a pole, where a local level frame does not work")
        if np.abs(lat - previous).max() < 1e-15:
            break
    _, r_n = earth.principal_radii(lat)
    _, lon_ends, longitude = _integrate(v_n[..., 0] / ((r_n + height) * np.cos(lat)), mark[1], dt)
    return lat, lat_ends, lon_ends, (latitude, longitude)


def _imu(motion: _Motion, lat: Array, height: Array) -> tuple[Array, Array]:
    """Angular rate and specific force in the body frame (..., 3) that go with a motion at a place."""
    C_nb = rpy_to_matrix(motion.rpy)
    earth_n = earth.earth_rate_n(lat)
    omega_in = earth_n + earth.transport_rate_n(lat, height, motion.v_n)
    f_n = motion.a_n + cross(omega_in + earth_n, motion.v_n)
    f_n[..., 2] += earth.gravity(lat, height)

    omega_b = np.einsum("...ji,...j->...i", C_nb, omega_in)
    s, c = np.sin(motion.rpy), np.cos(motion.rpy)
    d_roll, d_pitch, d_heading = motion.rpy_rate[..., 0], motion.rpy_rate[..., 1], motion.rpy_rate[..., 2]
    omega_b[..., 0] += d_roll - d_heading * s[..., 1]
    omega_b[..., 1] += d_pitch * c[..., 0] + d_heading * s[..., 0] * c[..., 1]
    omega_b[..., 2] += d_heading * c[..., 0] * c[..., 1] - d_pitch * s[..., 0]
    return omega_b, np.einsum("...ji,...j->...i", C_nb, f_n)


class Path:
    """A flight of `count` samples of `dt` seconds from `lla0` (3,) on; `polynomials`: vertical speed, speed, heading.

    Raises ValueError for a flight within 1 degree of a pole, where local-level axes turn too fast.
    """

    def __init__(self, polynomials: tuple[PPoly, PPoly, PPoly], lla0: Array, count: int, dt: float) -> None:
        self._polynomials, self._climb = polynomials, polynomials[0].antiderivative()
        self._lla0, self.samples, self.dt = lla0, count, dt
        # Memos of pure functions, the latter of two blocks: whoever else flies this path, in another thread too, would
        # put in the same.
        self._marks = {0: (_Sum(float(lla0[0])), _Sum(float(lla0[1])))}
        self._memo: dict[int, Trajectory] = {}
        self._stay_off_the_poles()

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.samples * self.dt

    def between(self, start: int, end: int) -> Trajectory:
        """The samples from instant `start` to instant `end`, 0 <= start < end <= samples; read-only views if it can."""
        if not 0 <= start < end <= self.samples:
            raise ValueError(f"instants {start} to {end} do not lie on a flight of {self.samples} samples")
        first, last = start // _BLOCK, (end - 1) // _BLOCK
        parts = []
        for number in range(first, last + 1):
            block, origin = self._block(number), number * _BLOCK
            parts.append(block.cut(max(start, origin) - origin, min(end, origin + _BLOCK) - origin))
        return parts[0] if first == last else joined(parts)

    def whole(self) -> Trajectory:
        """All of it, in memory."""
        return joined([self._evaluate(number) for number in range(math.ceil(self.samples / _BLOCK))])

    def _block(self, number: int) -> Trajectory:
        block = self._memo.get(number)
        if block is None:
            block = self._evaluate(number)
            latest = list(self._memo.items())[-1:]
            self._memo = dict(latest) | {number: block}
        return block

    def _mark(self, number: int) -> tuple[_Sum, _Sum]:
        """Latitude and longitude where a block begins."""
        known = number
        while known not in self._marks:
            known -= 1
        for before in range(known, number):
            points = self._points(before)
            height = self._lla0[2] + self._climb(points)
            v_n = _motion(self._polynomials, points).v_n
            after = _positions(v_n, height, self._marks[before], self.dt, _HIGHEST_LATITUDE)[3]
            self._remember(before + 1, after)
        return self._marks[number]

    def _remember(self, number: int, mark: tuple[_Sum, _Sum]) -> None:
        renew = number * _BLOCK % _SUMMED == 0
        self._marks[number] = (mark[0].renewed(self.dt), mark[1].renewed(self.dt)) if renew else mark

    def _instants(self, number: int) -> Array:
        """Times of a block (n + 1,)."""
        start = number * _BLOCK
        return np.arange(start, min(start + _BLOCK, self.samples) + 1, dtype=np.float64) * self.dt

    def _points(self, number: int) -> Array:
        """Times of the quadrature (n, 3)."""
        return np.asarray(self._instants(number)[:-1, None] + _POINTS * self.dt)

    def _evaluate(self, number: int) -> Trajectory:
        """One block."""
        mark, time, points = self._mark(number), self._instants(number), self._points(number)
        motion = _motion(self._polynomials, points)
        height = self._lla0[2] + self._climb(points)
        lla = np.empty((len(time), 3))
        lla[0, :2] = [so_far.start + so_far.total * self.dt for so_far in mark]
        lat, lla[1:, 0], lla[1:, 1], after = _positions(motion.v_n, height, mark, self.dt, _HIGHEST_LATITUDE)
        self._remember(number + 1, after)
        lla[:, 1] -= 2.0 * np.pi * np.round(lla[:, 1] / (2.0 * np.pi))
        lla[:, 2] = self._lla0[2] + self._climb(time)
        omega, f = _imu(motion, lat, height)
        omega_b, f_b = (np.einsum("j,njk->nk", _WEIGHTS, signal) for signal in (omega, f))
        instants = _motion(self._polynomials, time)
        rpy = instants.rpy
        rpy[:, 2] = np.mod(rpy[:, 2], 2.0 * np.pi)
        return Trajectory(self.dt, time, lla, instants.v_n, rpy, omega_b, f_b)

    def _stay_off_the_poles(self) -> None:
        """Look through the flight in coarse steps: what cannot be flown is refused before it begins."""
        dt = max(self.dt, _COARSE)
        mark = self._marks[0]
        for start in range(0, math.ceil(self.duration / dt), _BLOCK):
            end = min(start + _BLOCK, math.ceil(self.duration / dt))
            points = np.arange(start, end)[:, None] * dt + _POINTS * dt
            height = self._lla0[2] + self._climb(points)
            v_n = _motion(self._polynomials, points).v_n
            mark = _positions(v_n, height, mark, dt, _HIGHEST_LATITUDE - _CARE)[3]
            mark = (mark[0].renewed(dt), mark[1].renewed(dt))


def joined(parts: Sequence[Trajectory]) -> Trajectory:
    """Pieces of one flight that follow each other, as one."""
    first = parts[0]

    def instants(name: str) -> Array:
        return np.concatenate([getattr(first, name), *(getattr(part, name)[1:] for part in parts[1:])])

    def samples(name: str) -> Array:
        return np.concatenate([getattr(part, name) for part in parts])

    return Trajectory(
        first.dt,
        *(instants(name) for name in ("time", "lla", "v_n", "rpy")),
        *(samples(name) for name in ("omega_b", "f_b")),
    )
