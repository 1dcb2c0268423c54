"""How large an error may hide: protection levels, minimal detectable biases, and the Stanford diagram.

Shapes: (..., n) satellites, any leading axes, as in :mod:`ftcore.detection.raim`; gains and projectors are those of the
weighted least squares of unit measurements, so a bias of b metres is b / sigma there.
Sources: R.G. Brown and G.Y. Chin, GPS RAIM: calculation of thresholds and protection radius using chi-square methods
(1997), for the slope; R.G. Brown and P.W. McBurney, Navigation 35 (1988), and M. Brenner, Navigation 43 (1996), for the
separation of solutions.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from scipy.optimize import brentq
from scipy.stats import ncx2, norm

from ftcore.detection import chi_square
from ftcore.detection.result import Array, Ints, Mask

NOMINAL, MISLEADING, HAZARDOUS, UNAVAILABLE = 0, 1, 2, 3
"""Classes of `stanford`: protected; error beyond the protection level but not the alert limit (MI); beyond both while
declared good (HMI); not declared good."""

_BLIND: Final = 1e-7
"""Diagonal of the projector below which a satellite is not checked by the others."""


@lru_cache(maxsize=1024)
def noncentrality(dof: int, p_fa: float, p_md: float) -> float:
    """Noncentrality at which a chi-square test with false-alarm probability ``p_fa`` misses with ``p_md``.

    Raises ValueError for probabilities outside (0, 1), or that leave nothing to detect (p_fa + p_md >= 1).
    """
    if not (0.0 < p_fa < 1.0 and 0.0 < p_md < 1.0 and p_fa + p_md < 1.0):
        raise ValueError(f"false-alarm and missed-detection probability must be small: {p_fa} and {p_md} are not")
    limit = chi_square.threshold(p_fa, dof)
    top = 4.0 * (limit + dof)
    while ncx2.cdf(limit, dof, top) > p_md:
        top *= 2.0
    return float(brentq(lambda x: float(ncx2.cdf(limit, dof, x)) - p_md, 1e-12, top, xtol=1e-10, rtol=1e-12))


def noncentralities(dof: Ints, p_fa: float, p_md: float) -> Array:
    """`noncentrality` of an array of degrees of freedom; NaN where there are none."""
    return _noncentralities(int(dof.max(initial=0)), p_fa, p_md)[dof]


def minimal_detectable_bias(S: Array, sigma: Array, valid: Mask, lam: Array) -> Array:
    """Least bias (..., n) [m] that the test finds with the probability that ``lam`` (...) stands for.

    NaN for satellites that are not checked by the others. ``S`` (..., n, n), ``sigma`` (..., n) [m].
    """
    diagonal = np.diagonal(S, axis1=-2, axis2=-1)
    seen = valid & (diagonal > _BLIND)
    bias: Array = sigma * np.sqrt(lam[..., None] / np.where(seen, diagonal, 1.0))
    return np.where(seen, bias, np.nan)


def slopes(gain: Array, S: Array, valid: Mask) -> Array:
    """Horizontal error per unit of the root of noncentrality (..., n) [m]; infinite where unchecked, 0 if unused.

    ``gain`` (..., 4, n), rows east, north, up, clock.
    """
    diagonal = np.diagonal(S, axis1=-2, axis2=-1)
    seen = valid & (diagonal > _BLIND)
    horizontal = np.sqrt(gain[..., 0, :] ** 2 + gain[..., 1, :] ** 2)
    return np.where(seen, horizontal / np.sqrt(np.where(seen, diagonal, 1.0)), np.where(valid, np.inf, 0.0))


def slope_level(slope: Array, lam: Array) -> Array:
    """Horizontal protection level (...) [m]: the steepest slope times the least bias found; NaN without a test.

    The noise of the position itself is left out, as is usual: with the worst bias the level is exceeded unnoticed some
    times more often than ``p_md``. `separation_level` reckons with it.
    """
    level: Array = slope.max(axis=-1, initial=0.0) * np.sqrt(lam)
    return np.where(np.isfinite(level), level, np.nan)


def separation_level(slope: Array, gain: Array, covariance: Array, valid: Mask, p_fa: float, p_md: float) -> Array:
    """Horizontal protection level (...) [m] by the separation of the solutions with and without each satellite.

    With a fault on satellite i, the error is that of the solution without i, whose 1-sigma is s_i, plus at most the
    separation D_i that passes unnoticed: HPL = max_i (D_i + K_md s_i), D_i = K_fa slope_i, because the two solutions
    differ along one direction only, with covariance gain_i gain_i' / S_ii. K_fa shares p_fa among the satellites, two
    sides each. NaN where a satellite is not checked. Shapes as in `slopes`, ``covariance`` (..., 4, 4) [m^2].
    """
    k_fa, k_md = _deviates(valid.shape[-1], p_fa)[np.count_nonzero(valid, axis=-1)], _deviate(p_md)
    finite = np.where(np.isfinite(slope), slope, 0.0)
    # Covariance without i: C + gain_i gain_i' / S_ii, horizontal block; its greater eigenvalue in closed form.
    plane = np.sqrt(gain[..., 0, :] ** 2 + gain[..., 1, :] ** 2)
    ratio = finite / np.where(plane > 0.0, plane, 1.0)
    east, north = gain[..., 0, :] * ratio, gain[..., 1, :] * ratio
    ee = covariance[..., 0, 0, None] + east**2
    nn = covariance[..., 1, 1, None] + north**2
    en = covariance[..., 0, 1, None] + east * north
    variance = 0.5 * (ee + nn) + np.sqrt((0.5 * (ee - nn)) ** 2 + en**2)
    level = np.where(valid, k_fa[..., None] * slope + k_md * np.sqrt(variance), 0.0).max(axis=-1, initial=0.0)
    return np.where(np.isfinite(level) & (level > 0.0), level, np.nan)


def stanford(error: Array, level: Array, alert_limit: float, declared_good: Mask) -> Array:
    """Class of an epoch in the Stanford diagram, (...): NOMINAL, MISLEADING, HAZARDOUS or UNAVAILABLE.

    Args:
        error: true horizontal error [m]; NaN where there is no solution.
        level: protection level [m]; NaN where there is none.
        alert_limit: [m]; a larger protection level makes the position unavailable.
        declared_good: whether the receiver vouches for it otherwise.
    """
    available = declared_good & (level <= alert_limit) & np.isfinite(error)
    beyond = np.where(error > alert_limit, HAZARDOUS, np.where(error > level, MISLEADING, NOMINAL))
    return np.where(available, beyond, UNAVAILABLE).astype(np.float64)


@lru_cache(maxsize=256)
def _noncentralities(most: int, p_fa: float, p_md: float) -> Array:
    return np.array([np.nan] + [noncentrality(dof, p_fa, p_md) for dof in range(1, most + 1)])


@lru_cache(maxsize=64)
def _deviate(p: float) -> float:
    return float(norm.isf(p))


@lru_cache(maxsize=256)
def _deviates(most: int, p_fa: float) -> Array:
    """Two-sided normal deviates of ``p_fa`` shared among 0 to ``most`` satellites."""
    return np.asarray(norm.isf(p_fa / (2.0 * np.maximum(np.arange(most + 1), 1))))
