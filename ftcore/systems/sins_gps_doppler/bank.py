"""The bank of 21-state filters of the SINS/GPS/Doppler system, carried over together.

    0, 1  local     the federation's local filters, with their shares of noise (Zhang 1992 (28)-(31))
    2     master    the federation's master
    3     fused     the global estimate, carried over without inflation: what a measurement is admitted against
    4, 5  alone     SINS/GPS and SINS/Doppler as if the other did not exist: baselines, and what the tests run on
    6     central   all sensors, no FDI, on the unprotected strapdown
    7, 8  prior     the same starts as 4 and 5 without measurements: P2 of the state chi-square test
    9, 10 propagator  two that take turns: the reference of the two-propagator test, and a newer one from the fused
    11    witness     all sensors that are trusted, the altimeter among them: what the altimeter is judged by

Arrays are ``(runs, 12, 21)`` and ``(runs, 12, 21, 21)``; one matrix product carries all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.estimation import federated, kalman
from ftcore.estimation.federated import Bank, Estimate, Sharing
from ftcore.estimation.ins_error import ALTIMETER_BIAS
from ftcore.systems.sins_gps_doppler import altimeter
from ftcore.systems.sins_gps_doppler.strapdowns import Damping

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

LOCAL, MASTER, FUSED, ALONE, CENTRAL, PRIOR, REFERENCE, NEWER, WITNESS = (0, 1), 2, 3, (4, 5), 6, (7, 8), 9, 10, 11
SIZE = 12
HEIGHT, CLIMB = 2, 5
"""States that damping moves: errors of height and of vertical velocity."""
BLOCK = 8
"""Runs whose covariances are carried over together: so many stay in a core's cache (measured, twice the speed)."""
INS_OF_FILTER = np.array([0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0])
"""Which strapdown each filter's errors belong to: 0 protected, 1 unprotected."""


@dataclass(frozen=True)
class Filters:
    """All filters: ``x (runs, 11, 21)``, ``P (runs, 11, 21, 21)``."""

    x: Array
    P: Array

    def estimate(self, i: int) -> Estimate:
        """One filter."""
        return Estimate(self.x[:, i], self.P[:, i])

    @property
    def federation(self) -> Bank:
        """Locals and master as :mod:`ftcore.estimation.federated` wants them."""
        return Bank(self.x[:, :3], self.P[:, :3])


def start(runs: int, P0: Array, sharing: Sharing) -> Filters:
    """All filters at zero error with covariance ``P0 (n, n)``, the locals inflated."""
    n = len(P0)
    x = np.zeros((runs, SIZE, n))
    P = np.array(np.broadcast_to(P0, (runs, SIZE, n, n)))
    whole = federated.start(np.zeros((1, n)), P0[None], sharing)
    P[:, :3] = whole.P
    return Filters(x, P)


def predict(filters: Filters, Phi: Array, Q: Array, sharing: Sharing, members: Flags) -> Filters:
    """Carry all filters over with ``Phi``, ``Q`` ``(runs, 2, 21, 21)`` of the two strapdowns; locals share Q."""
    runs = len(filters.x)
    factors = np.ones((runs, SIZE, 1, 1))
    factors[:, :3, 0, 0] = federated.noise_factors(sharing, members)
    if runs <= BLOCK:
        return _predict(filters, Phi, Q, factors)
    x, P = np.empty_like(filters.x), np.empty_like(filters.P)
    for start in range(0, runs, BLOCK):
        part = slice(start, start + BLOCK)
        done = _predict(Filters(filters.x[part], filters.P[part]), Phi[part], Q[part], factors[part])
        x[part], P[part] = done.x, done.P
    return Filters(x, P)


def _predict(filters: Filters, Phi: Array, Q: Array, factors: Array) -> Filters:
    noise = Q[:, INS_OF_FILTER]
    noise *= factors
    return Filters(*kalman.predict(filters.x, filters.P, Phi[:, INS_OF_FILTER], noise))


def damp(filters: Filters, damping: Damping, variance: float, factors: Array, wrong: Flags | None = None) -> Filters:
    """All filters after their strapdown was damped; ``variance`` of the altimeter's noise [m^2], shared as process
    noise by ``factors (runs or 1, 3)`` of locals and master.

    x <- D x and P <- D P D' + g g' variance, where D = I - g a', a the altimeter's row and g its gains: two rows and
    columns change. The witness measures with the altimeter instead, and knows by how much the strapdown is moved. Where
    the reading is known to have been ``wrong (runs,)`` all filters on the protected strapdown know just that.
    """
    if not damping.gains.any():
        return filters
    a = altimeter.row(damping, filters.x.shape[-1])
    gains, right = damping.gains, damping.gains[:, 0].any(axis=-1)
    if wrong is not None:
        right = right & ~wrong
        gains = gains * np.stack([right, np.ones_like(right)], axis=-1)[..., None]
    g = gains[:, INS_OF_FILTER[:WITNESS]]
    k1, k2 = g[..., 0], g[..., 1]
    noise = np.full((len(a), WITNESS), variance)
    noise[:, :3] *= factors
    x, P = filters.x.copy(), filters.P.copy()
    others = P[:, :WITNESS]
    seen = np.vecdot(x[:, :WITNESS], a[:, None])
    w = np.matvec(others, a[:, None])
    c = 0.5 * (np.vecdot(w, a[:, None]) + noise)
    w[..., HEIGHT] -= c * k1
    w[..., CLIMB] -= c * k2
    down, slower = k1[..., None] * w, k2[..., None] * w
    others[..., HEIGHT, :] -= down
    others[..., CLIMB, :] -= slower
    others[..., :, HEIGHT] -= down
    others[..., :, CLIMB] -= slower
    others[..., CLIMB, HEIGHT] = others[..., HEIGHT, CLIMB]  # the two were added up in another order
    x[:, :WITNESS, HEIGHT] -= k1 * seen
    x[:, :WITNESS, CLIMB] -= k2 * seen

    # One row: the update is a division.
    w = np.matvec(P[:, WITNESS], a)
    S = np.vecdot(w, a) + variance
    gain = w * (right / S)[:, None]
    x[:, WITNESS] += gain * (damping.above[:, 0] - np.vecdot(a, x[:, WITNESS]))[:, None]
    w *= np.sqrt(right / S)[:, None]
    P[:, WITNESS] -= w[:, :, None] * w[:, None, :]
    moved = damping.gains[:, 0] * damping.above[:, :1]
    x[:, WITNESS, [HEIGHT, CLIMB]] -= moved
    if wrong is not None and wrong.any():
        moved = np.where(wrong[:, None], moved, 0.0)
        for i in np.flatnonzero(INS_OF_FILTER[:WITNESS] == 0).tolist():
            x[:, i, [HEIGHT, CLIMB]] -= moved
    return Filters(x, P)


def reopen_bias(filters: Filters, opened: Array, shift: Array, factors: Array) -> Filters:
    """The altimeter comes back, perhaps with another bias: every filter on the protected strapdown is told so.

    ``opened (runs,)``: variance of what may have changed [m^2], of which each filter has its share by ``factors (runs
    or 1, 3)``; ``shift (runs,)``: by how much it was found to have changed [m].
    """
    if not opened.any():
        return filters
    x, P = filters.x.copy(), filters.P.copy()
    protected = np.flatnonzero(INS_OF_FILTER == 0)
    share = np.ones((len(P), len(protected)))
    share[:, :3] = factors
    P[:, protected, ALTIMETER_BIAS, ALTIMETER_BIAS] += share * opened[:, None]
    x[:, protected, ALTIMETER_BIAS] -= shift[:, None]
    return Filters(x, P)


def replaced(filters: Filters, changes: dict[int, tuple[Array, Array]]) -> Filters:
    """The bank with some filters replaced: index -> (x, P)."""
    x, P = filters.x.copy(), filters.P.copy()
    for i, (x_i, P_i) in changes.items():
        x[:, i], P[:, i] = x_i, P_i
    return Filters(x, P)


def reset_where(filters: Filters, indices: tuple[int, ...], where: Flags, source: Estimate) -> Filters:
    """Filters ``indices`` restart from ``source`` in the runs ``where``; untouched if there are none."""
    if not where.any():
        return filters
    x, P = filters.x.copy(), filters.P.copy()
    for i in indices:
        x[where, i], P[where, i] = source.x[where], source.P[where]
    return Filters(x, P)
