"""Do the satellites agree, and if not, which one is wrong?

Every test of consistency here is one quadratic form, q = y' A y, chi-square on ``dof`` while nothing has failed, of
measurements y made unit by their sigma:

    snapshot     A = S, the projector of weighted least squares (Chey 2004 (10)-(12)): dof n - 4
    innovation   A = V^-1, V the covariance of a Kalman filter's innovations (Chey 2004, section 3): dof n

and z = A y is all that isolation needs. Without measurement i the form is q - w_i^2 with w_i = z_i / sqrt(A_ii), the
residual of i against all others, standard normal while nothing has failed; A and z without i follow by a rank-one
step. So leaving one out, for all satellites of all runs, costs one division, and leaving out the next as much again.

Isolation names a satellite only where the answer is the only one. The set without it must pass its own test, which
takes redundancy to spare; and every set that accuses another in its place must fit worse by at least the margin
``chi2.isf(p, 1)``. With the fault on satellite a, b wins over a by a margin M with a probability of at most
Q(sqrt(M)), whatever the size of the fault and however alike the two look; the mere minimum of the residual (M = 0) has
no such bound. What cannot be told apart is not guessed: the answer is CANNOT_ISOLATE.

One after the other is no way to find two: the largest residual of two faults may be an innocent's, between the two.
Where no exclusion of one suffices, all pairs are tried: with the redundancy for it, the one that passes its test is
named where every other pair fits worse, by the margin above where it shares a satellite with the first, else by
``chi2.isf(p, 2)``. With the faults on the pair A, q_A - q_B is at most the part of the noise in span(A, B) and outside
of span(A), chi-square on 2 at most: B wins by the margin with a probability of at most p. More than two are looked for
one after the other, where no pair passes.

Shapes: (..., n), any leading axes. Sources: J. Chey et al., ICCAS 2004; R.G. Brown, Navigation 39 (1992); the margin is
a likelihood ratio of two single-fault hypotheses with unknown sizes (FTLab).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.stats import chi2

from ftcore.detection import chi_square
from ftcore.detection.result import Array, Ints, Mask

CONSISTENT, EXCLUDED, CANNOT_ISOLATE, CANNOT_DETECT, NO_FIX = 0, 1, 2, 3, 4
"""Values of `Isolation.state`: nothing wrong; the culprits are left out and the rest agrees; something is wrong, but
who cannot be told; too few satellites to tell whether anything is wrong; too few for any answer."""

_BLIND = 1e-7
"""A_ii below which a measurement is not checked by the others (A_ii is 1 where they check it best)."""


@dataclass(frozen=True, slots=True)
class Consistency:
    """A quadratic form of measurements; see the module."""

    A: Array
    """(..., n, n), rows and columns of measurements that are not valid 0."""
    y: Array
    """Unit measurements, (..., n), 0 where not valid."""
    z: Array
    """A y, (..., n)."""
    statistic: Array
    """q = y' A y, (...)."""
    dof: Ints
    """(...); 0 where there is nothing to judge."""
    valid: Mask
    """(..., n)."""

    @property
    def squared(self) -> Array:
        """w^2, (..., n); 0 for measurements that the others do not check."""
        diagonal = np.diagonal(self.A, axis1=-2, axis2=-1)
        seen = self.valid & (diagonal > _BLIND)
        return np.where(seen, self.z**2 / np.where(seen, diagonal, 1.0), 0.0)

    @property
    def normalised(self) -> Array:
        """w, (..., n): each measurement against all others, standard normal; NaN where they do not check it."""
        diagonal = np.diagonal(self.A, axis1=-2, axis2=-1)
        seen = self.valid & (diagonal > _BLIND)
        return np.where(seen, self.z / np.sqrt(np.where(seen, diagonal, 1.0)), np.nan)


@dataclass(frozen=True, slots=True)
class Isolation:
    """What came of a test and of the search for the culprit."""

    state: NDArrayInt8
    """(...): CONSISTENT, EXCLUDED, CANNOT_ISOLATE or CANNOT_DETECT."""
    excluded: Mask
    """(..., n); nobody where the culprit cannot be told."""
    alarm: Mask
    """(...): the test of all measurements together."""
    threshold: Array
    """(...), of that test; 0 where dof is 0."""
    remaining: Consistency
    """The form without the excluded."""
    separation: Array
    """(...): by how much the nearest other explanation fits worse; infinite where nobody is accused."""


def from_projector(S: Array, y: Array, residual: Array, dof: Ints, valid: Mask) -> Consistency:
    """The snapshot form, from the projector (..., n, n), the unit measurements and their residual S y, (..., n)."""
    return Consistency(S, np.where(valid, y, 0.0), residual, np.asarray(np.vecdot(residual, residual)), dof, valid)


def from_whitened(whitener: Array, whitened: Array, innovation: Array, valid: Mask) -> Consistency:
    """The innovation form, from L^-1 (..., n, n), L^-1 nu and nu (..., n) of a `kalman.Innovation`."""
    Lt = np.ascontiguousarray(whitener.swapaxes(-1, -2))
    valid = np.broadcast_to(valid, whitened.shape)
    A = np.where(valid[..., :, None] & valid[..., None, :], Lt @ whitener, 0.0)
    z = np.where(valid, np.matvec(Lt, whitened), 0.0)
    statistic = np.asarray(np.vecdot(whitened, whitened))
    dof = np.count_nonzero(valid, axis=-1)
    return Consistency(A, np.where(valid, innovation, 0.0), z, statistic, np.asarray(dof), valid)


def parity_statistic(H: Array, y: Array, sigma: Array, valid: Mask) -> Array:
    """The snapshot statistic by the parity space, (...): the same number on another way.

    p = P y with P P' = I and P H = 0, from the QR decomposition of the weighted H (..., n, m); q = p'p. A measurement
    that is not valid has a row of zeros, and its own parity direction holds nothing. Source: Sturza, Navigation 35
    (1988); equality in Brown (1992).
    """
    weight = np.where(valid, 1.0 / sigma, 0.0)
    Q, _ = np.linalg.qr(H * weight[..., None], mode="complete")
    p = np.vecmat(np.where(valid, y, 0.0) * weight, Q[..., H.shape[-1] :])
    return np.asarray(np.vecdot(p, p))


@lru_cache(maxsize=64)
def margin(p_wrong: float) -> float:
    """Margin that a wrong satellite beats a given other by with a probability of at most ``p_wrong`` / 2."""
    return float(chi2.isf(p_wrong, 1))


def isolate(c: Consistency, p_fa: float, least_dof: Ints | int = 1, separation: float = 0.0) -> Isolation:
    """Test, and leave out one after the other until the rest passes its own test.

    Args:
        c: the form of all measurements.
        p_fa: false-alarm probability of each test.
        least_dof: degrees of freedom that must be left after an exclusion; 1 at least, so that the rest can be tested.
        separation: by how much every other explanation must fit worse; 0 is the plain minimum of the residual.

    The loop ends with redundancy, after n - 1 turns at most; it is one over repeated exclusions, all runs in step.
    Where its first exclusion does not suffice, a pair that does takes its place, or nobody where several pairs do.
    """
    _, limit, alarm = chi_square.decide(c.statistic, c.dof, p_fa)
    if not alarm.any():
        state = np.where(c.dof <= 0, CANNOT_DETECT, CONSISTENT).astype(np.int8)
        nobody, unrivalled = np.zeros(c.valid.shape, bool), np.full(c.statistic.shape, np.inf)
        return Isolation(state, nobody, alarm, limit, c, unrivalled)
    left = c
    failing = alarm
    excluded = np.zeros(c.valid.shape, bool)
    order: list[tuple[Ints, Mask]] = []
    single = np.zeros_like(alarm)
    while True:
        candidate = _candidates(left)
        going = failing & (left.dof > least_dof) & candidate.any(axis=-1)
        if not going.any():
            break
        w2 = np.where(candidate, left.squared, -1.0)
        worst = w2.argmax(axis=-1)
        left = _without(left, worst, going)
        hit = going[..., None] & (np.arange(c.valid.shape[-1]) == worst[..., None])
        excluded = excluded | hit
        order.append((worst, going))
        failing = failing & (left.statistic >= chi_square.threshold(p_fa, left.dof))
        if len(order) == 1:
            single = alarm & going & ~failing
    named = alarm & ~failing & excluded.any(axis=-1)
    nearest = np.full(c.statistic.shape, np.inf)
    if order and named.any():
        nearest = np.where(named, _nearest_other(c, order, excluded), np.inf)
        named = named & (nearest >= separation)
    state = np.where(c.dof <= 0, CANNOT_DETECT, np.where(alarm, np.where(named, EXCLUDED, CANNOT_ISOLATE), CONSISTENT))
    keep = named if order else np.zeros_like(alarm)
    remaining = _chosen(keep, left, c)
    found = Isolation(state.astype(np.int8), excluded & keep[..., None], alarm, limit, remaining, nearest)
    several = alarm & (c.dof - 2 >= least_dof) & (~keep | (excluded.sum(axis=-1) > 1)) & ~single
    return _by_pairs(c, found, several, p_fa, separation) if several.any() else found


NDArrayAny = np.ndarray[Any, Any]
NDArrayInt8 = np.ndarray[tuple[int, ...], np.dtype[np.int8]]
_Stage = tuple[Ints, Mask]


def _candidates(c: Consistency) -> Mask:
    return np.asarray(c.valid & (np.diagonal(c.A, axis1=-2, axis2=-1) > _BLIND))


def _without(c: Consistency, which: Ints, where: Mask) -> Consistency:
    """The form without measurement ``which`` (...), in the runs ``where``: A - a a' / a_i, z - a z_i / a_i."""
    i = which[..., None]
    column = np.take_along_axis(c.A, i[..., None], axis=-1)[..., 0]
    pivot = np.take_along_axis(column, i, axis=-1)
    z_i = np.take_along_axis(c.z, i, axis=-1)
    scale = np.where(where[..., None] & (pivot > _BLIND), 1.0 / np.where(pivot > _BLIND, pivot, 1.0), 0.0)
    gone = where[..., None] & (np.arange(c.z.shape[-1]) == i)
    A = c.A - (column * scale)[..., :, None] * column[..., None, :]
    kept = ~gone
    A = np.where(kept[..., :, None] & kept[..., None, :], A, 0.0)
    z = np.where(kept, c.z - column * (scale * z_i), 0.0)
    # Not q - w_i^2: a gross fault would leave nothing but rounding.
    statistic = np.where(where, np.maximum(np.vecdot(c.y, z), 0.0), c.statistic)
    return Consistency(A, c.y, z, statistic, c.dof - where, c.valid & kept)


def _nearest_other(c: Consistency, order: list[_Stage], excluded: Mask) -> Array:
    """Least excess of the statistic over all sets that accuse one other measurement in place of one accused, (...)."""
    nearest = np.full(c.statistic.shape, np.inf)
    for spared, (accused, when) in enumerate(order):
        base = c
        for turn, (which, where) in enumerate(order):
            if turn != spared:
                base = _without(base, which, where)
        w2 = base.squared
        mine = np.take_along_axis(w2, accused[..., None], axis=-1)
        others = np.where(base.valid & ~excluded, w2, -np.inf).max(axis=-1)
        nearest = np.where(when, np.minimum(nearest, mine[..., 0] - others), nearest)
    return nearest


def _by_pairs(c: Consistency, found: Isolation, where: Mask, p_fa: float, separation: float) -> Isolation:
    """The isolation with a pair in the runs ``where`` in which one passes: the only one, or nobody."""
    rows = np.nonzero(where)
    some = Consistency(c.A[rows], c.y[rows], c.z[rows], c.statistic[rows], c.dof[rows], c.valid[rows])
    statistic = _pair_statistics(some)
    runs, n = some.y.shape
    flat = statistic.reshape(runs, n * n)
    best = flat.argmin(axis=-1)
    i, j = best // n, best % n
    least = np.take_along_axis(flat, best[:, None], axis=-1)
    passes = least[:, 0] < chi_square.threshold(p_fa, some.dof - 2)
    if not passes.any():
        return found
    pair = (np.arange(n) == i[:, None]) | (np.arange(n) == j[:, None])
    shares = pair[:, :, None] | pair[:, None, :]
    other = ~(pair[:, :, None] & pair[:, None, :])
    excess = np.where(other, statistic - least[..., None], np.inf)
    apart = float(chi2.isf(chi2.sf(separation, 1), 2))
    sure = passes & (excess >= np.where(shares, separation, apart)).all(axis=(-1, -2))
    nearest = excess.min(axis=(-1, -2))
    # Who is named already stays named by the very same numbers.
    same = sure & (found.excluded[rows] == pair).all(axis=-1)
    anew = passes & ~same
    rest = _without(_without(some, i, sure), j, sure)
    into = tuple(axis[anew] for axis in rows)
    left = found.remaining

    def put(old: NDArrayAny, new: NDArrayAny) -> NDArrayAny:
        after = old.copy()
        after[into] = new[anew]
        return after

    return replace(
        found,
        state=put(found.state, np.where(sure, EXCLUDED, CANNOT_ISOLATE).astype(np.int8)),
        excluded=put(found.excluded, pair & sure[:, None]),
        separation=put(found.separation, nearest),
        remaining=Consistency(
            put(left.A, rest.A),
            left.y,
            put(left.z, rest.z),
            put(left.statistic, rest.statistic),
            put(left.dof, rest.dof),
            put(left.valid, rest.valid),
        ),
    )


def _pair_statistics(c: Consistency) -> Array:
    """The statistic without each pair of measurements, (runs, n, n) with i < j; infinite for what is no pair."""
    runs, n = c.y.shape
    found = np.full((runs, n, n), np.inf)
    everywhere = np.ones(runs, bool)
    for i in range(n - 1):
        candidate = _candidates(c)[:, i]
        base = _without(c, np.full(runs, i), everywhere & candidate)
        later = slice(i + 1, n)
        pivot = np.diagonal(base.A, axis1=-2, axis2=-1)[:, later]
        seen = candidate[:, None] & base.valid[:, later] & (pivot > _BLIND)
        scale = np.where(seen, base.z[:, later] / np.where(seen, pivot, 1.0), 0.0)
        z = base.z[:, None] - base.A[:, later] * scale[..., None]
        # As in `_without`: what a gross fault leaves of itself in its own place is rounding.
        z[:, np.arange(n - 1 - i), np.arange(i + 1, n)] = 0.0
        found[:, i, later] = np.where(seen, np.maximum(np.vecdot(base.y[:, None], z), 0.0), np.inf)
    return found


def _chosen(where: Mask, a: Consistency, b: Consistency) -> Consistency:
    """``a`` in the runs ``where``, ``b`` elsewhere."""
    if not where.any():
        return b
    row, table = where[..., None], where[..., None, None]
    return Consistency(
        np.where(table, a.A, b.A),
        b.y,
        np.where(row, a.z, b.z),
        np.where(where, a.statistic, b.statistic),
        np.where(where, a.dof, b.dof),
        np.where(row, a.valid, b.valid),
    )
