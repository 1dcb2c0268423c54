"""Tolerant fusion: the estimate averaged over which subsystems may be believed.

Each of s subsystems has a probability beta_i of being valid. For every subset A of them there is an estimate that takes
in the measurements of A only, and a weight, the probability that A are the valid ones and the others are not,

    alpha_A = prod_{i in A} beta_i prod_{i not in A} (1 - beta_i),    sum_A alpha_A = 1.                    (16)-(17)

(17) as printed adds, for SINS alone, the terms of inclusion and exclusion with the wrong signs, and lists GPS twice.
The fused estimate is the mean of this mixture, its covariance includes the spread between the subsets, SINS alone
being one of them,

    x = sum_A alpha_A x_A,    P = sum_A alpha_A [P_A + (x_A - x)(x_A - x)'],                                (35)-(36)

once for every model of an IMM (:mod:`ftcore.estimation.imm`), whose mixture then is the fused estimate.

All subsets at once. An update with A is x_A = x + (H P)' u_A, P_A = P - (H P)' G_A (H P), where G_A holds the inverse
of A's part of S = H P H' + R and zeros elsewhere, and u_A = G_A (y - H x). So (35)-(36) need no P_A: the mixture is
averaged among measurements, m x m, and the state is touched once. The inverses grow subsystem by subsystem, each step
doubling the subsets through the Schur complement of the new block.

All estimates at once. Whatever predicts the same measurement, the models of one filter or of several, or a reference to
test against, is compared with it by one call, `residuals`, whose parts then go where they belong.

Shapes: runs lead; M models, n states, m rows of all s subsystems one below the other as `Layout` has them; prior.x
(runs, M, n); y (runs, m); H (runs, m, n); R (m,) or (runs, m) variances, or (runs, m, m) with blocks by subsystem.
Subset A stands at the index whose bit i is set when subsystem i belongs to it: 0 is SINS alone, 2^s - 1 are all.
Source: C. Yang, A. Mohammadi and Q.-W. Chen, Sensors 16 (2016), section 3.3.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np

from ftcore.estimation import imm, kalman
from ftcore.estimation.imm import Mixture
from ftcore.estimation.kalman import Array, Ints, Mask

Drives = Literal["smallest", "accepted"]
DRIVES: tuple[Drives, ...] = get_args(Drives)

_LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, slots=True)
class Layout:
    """Which rows of a stacked measurement belong to which subsystem: names, and how many rows each has, in order.

    Raises ValueError for no subsystem, a subsystem without rows, or names that do not match.
    """

    names: tuple[str, ...]
    sizes: tuple[int, ...]

    def __post_init__(self) -> None:
        """Refuse what cannot be laid out."""
        if not self.sizes or min(self.sizes) < 1 or len(self.names) != len(self.sizes):
            raise ValueError(f"one positive number of rows a subsystem: {self.sizes} do not fit {self.names}")

    @property
    def rows(self) -> int:
        """All rows, m."""
        return sum(self.sizes)

    @property
    def slices(self) -> tuple[slice, ...]:
        """The rows of each subsystem."""
        return _slices(self.sizes)

    @property
    def membership(self) -> Array:
        """(s, m): 1 where the row belongs to the subsystem."""
        return _membership(self.sizes)

    @property
    def own_blocks(self) -> Array:
        """(m, m): 1 where row and column belong to the same subsystem."""
        return _own_blocks(self.sizes)

    @property
    def places(self) -> Ints:
        """Row numbers of each subsystem, (s, largest size); m, one past the last, where it has fewer rows."""
        return _places(self.sizes)

    def count(self, valid: Mask) -> Ints:
        """Valid rows of each subsystem, (runs, s), of `valid` (runs, m)."""
        return np.asarray(np.rint(valid @ self.membership.T), dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Residuals:
    """A measurement against K estimates that predict it; rows that are not valid are 0, and unit in S."""

    layout: Layout
    H: Array
    """(runs, m, n)."""
    HP: Array
    """H P, (runs, K, m, n)."""
    HPH: Array
    """H P H', (runs, K, m, m)."""
    S: Array
    """H P H' + R, (runs, K, m, m)."""
    nu: Array
    """y - H x, (runs, K, m)."""
    whitener: Array
    """L^-1 of every subsystem's own block of S, (runs, K, m, m), zeros between subsystems."""
    whitened: Array
    """L^-1 nu, (runs, K, m)."""
    q: Array
    """nu' S^-1 nu of every subsystem by itself, (runs, K, s): chi-square on `dof`; 0 where it has no valid row."""
    dof: Ints
    """Valid rows of each subsystem, (runs, s)."""

    def of(self, which: slice) -> "Residuals":
        """Those of some of the estimates."""
        return Residuals(
            self.layout,
            self.H,
            self.HP[:, which],
            self.HPH[:, which],
            self.S[:, which],
            self.nu[:, which],
            self.whitener[:, which],
            self.whitened[:, which],
            self.q[:, which],
            self.dof,
        )


@dataclass(frozen=True, slots=True)
class SubsetUpdates:
    """The updates of every model with every subset of the subsystems, in the space of the measurements."""

    prior: Mixture
    residuals: Residuals
    """Of the models' predictions."""
    inverse: Array
    """G_A, (runs, M, 2^s, m, m)."""
    weighed: Array
    """u_A = G_A (y - H x), (runs, M, 2^s, m)."""
    log_likelihood: Array
    """Of each subsystem's measurement under each model's prediction, (runs, M, s); 0 where it has no valid row."""

    @property
    def layout(self) -> Layout:
        """The subsystems."""
        return self.residuals.layout

    @property
    def dof(self) -> Ints:
        """Valid rows of each subsystem, (runs, s)."""
        return self.residuals.dof

    def x(self) -> Array:
        """The states of (18)-(33), (runs, M, 2^s, n)."""
        return np.asarray(self.prior.x[:, :, None] + self.weighed @ self.residuals.HP)

    def P(self) -> Array:
        """The covariances of (19)-(32), (runs, M, 2^s, n, n)."""
        HP = self.residuals.HP[:, :, None]
        return kalman.symmetric(self.prior.P[:, :, None] - HP.swapaxes(-1, -2) @ self.inverse @ HP)


@dataclass(frozen=True, slots=True)
class Fusion:
    """The fused estimate of an epoch."""

    mixture: Mixture
    """Every model's fused estimate and the updated mode probabilities: what goes on into the next epoch."""
    x: Array
    """All models together, (runs, n)."""
    P: Array
    """(runs, n, n)."""
    alpha: Array
    """Weights of the subsets, (runs, 2^s)."""
    driver: Ints
    """The subsystem whose likelihood updated the mode probabilities, (runs,); -1 where none did."""


def members(s: int) -> Mask:
    """Which subsystems belong to which subset, (2^s, s)."""
    return _members(s)


def subset_names(names: tuple[str, ...], alone: str = "sins") -> tuple[str, ...]:
    """Names of the subsets in the order of the weights, as `gps+cns`; that of the empty one is `alone`."""
    return tuple(
        "+".join(n for n, inside in zip(names, row, strict=True) if inside) or alone for row in members(len(names))
    )


def subset_weights(beta: Array) -> Array:
    """alpha (..., 2^s) of validities beta (..., s): the probability that just these subsystems are valid, (17)."""
    b = beta[..., None, :]
    return np.asarray(np.where(members(beta.shape[-1]), b, 1.0 - b).prod(axis=-1))


def residuals(x: Array, P: Array, y: Array, H: Array, R: Array, layout: Layout, valid: Mask | None = None) -> Residuals:
    """Compare a measurement of all subsystems with K estimates x (runs, K, n), P (runs, K, n, n).

    y, H, R, `valid` and errors as in `subset_updates`.
    """
    y, H, R = stacked(y, H, R, layout, valid)
    HP = H[:, None] @ P
    HPH = HP @ np.ascontiguousarray(H.swapaxes(-1, -2))[:, None]
    S = HPH + R[:, None]
    nu = y[:, None] - np.matvec(H[:, None], x)
    # Without the blocks between subsystems, one factor whitens each of them by itself.
    whitener = kalman.triangular_inverse(kalman.cholesky(S * layout.own_blocks))
    whitened = np.matvec(whitener, nu)
    q = np.square(whitened) @ layout.membership.T
    dof = np.array([layout.sizes]) if valid is None else layout.count(valid)
    return Residuals(layout, H, HP, HPH, S, nu, whitener, whitened, q, dof)


def subset_updates(
    prior: Mixture, y: Array, H: Array, R: Array, layout: Layout, valid: Mask | None = None
) -> SubsetUpdates:
    """Update every model of `prior` with every subset of the subsystems, (18)-(34).

    Shapes as the module has them. `valid` (runs, m): a row that is False drops out whatever y, H and R hold there (NaN
    too); a subsystem without a valid row adds nothing to any subset. Raises ValueError when the rows of y are not those
    of the layout, and LinAlgError when some S is not positive definite.
    """
    return updates_of([prior], residuals(prior.x, prior.P, y, H, R, layout, valid))[0]


def updates_of(priors: Sequence[Mixture], r: Residuals) -> list[SubsetUpdates]:
    """`subset_updates` of several filters at once, from the residuals of all their models, one filter's after the
    other's."""
    inverse = _subset_inverses(r.S, r.whitener, r.layout)
    weighed = np.matvec(inverse, r.nu[:, :, None])
    log_scale = np.log(np.diagonal(r.whitener, axis1=-2, axis2=-1)) @ r.layout.membership.T
    log_likelihood = log_scale - 0.5 * r.q - 0.5 * _LOG_2PI * r.dof[:, None]
    found, start = [], 0
    for prior in priors:
        models = slice(start, start + prior.log_mu.shape[-1])
        start = models.stop
        found.append(
            SubsetUpdates(prior, r.of(models), inverse[:, models], weighed[:, models], log_likelihood[:, models])
        )
    return found


def fuse(updates: SubsetUpdates, beta: Array, q: Array, drives: Drives = "smallest") -> Fusion:
    """The fused estimate of every model, (35)-(36), the updated mode probabilities, and all models combined.

    beta (runs, s): validity of each subsystem, taken as 0 where it has no valid row. q (runs, s): its detection value.
    `drives`: whose likelihood updates the mode probabilities. "smallest" is the paper's, the subsystem with the
    smallest q; "accepted" the same among those with beta > 0, so that, when all are rejected, the transition matrix
    alone moves the probabilities. Raises ValueError for another word.
    """
    if drives not in DRIVES:
        raise ValueError(f"mode probabilities are driven by one of {', '.join(DRIVES)}, not {drives!r}")
    present = updates.dof > 0
    beta = np.where(present, beta, 0.0)
    alpha = subset_weights(beta)
    G, u, HP = updates.inverse, updates.weighed, updates.residuals.HP
    m = G.shape[-1]
    a = alpha[:, None, None, :]
    mean = (a @ u)[..., 0, :]
    deviation = (u - mean[..., None, :]) * np.sqrt(alpha)[:, None, :, None]
    among = (a @ G.reshape(*G.shape[:-2], m * m)).reshape(*mean.shape, m)
    among -= deviation.swapaxes(-1, -2) @ deviation
    x = updates.prior.x + np.vecmat(mean, HP)
    P = kalman.symmetric(updates.prior.P - HP.swapaxes(-1, -2) @ (among @ HP))
    chosen = driver(q, updates.dof, present if drives == "smallest" else beta > 0.0)
    log_mu = imm.reweigh(updates.prior.log_mu, _of_driver(updates.log_likelihood, chosen))
    mixture = Mixture(x, P, log_mu)
    return Fusion(mixture, *imm.combine(mixture), alpha, chosen)


def driver(q: Array, dof: Ints, eligible: Mask) -> Ints:
    """The eligible subsystem with the smallest q, (runs,), -1 where none is eligible.

    q, dof and eligible (runs, s). Subsystems with unlike degrees of freedom are compared by Wilson's and Hilferty's
    normal deviate of q, the order of their tail probabilities; for like ones this is the order of q. Source: step 2.
    """
    ninth = 2.0 / (9.0 * np.maximum(dof, 1))
    deviate = (np.cbrt(q / np.maximum(dof, 1)) - (1.0 - ninth)) / np.sqrt(ninth)
    deviate = np.where(eligible, deviate, np.inf)
    return np.where(eligible.any(axis=-1), deviate.argmin(axis=-1), -1)


def stacked(y: Array, H: Array, R: Array, layout: Layout, valid: Mask | None) -> tuple[Array, Array, Array]:
    """y (runs, m), H (runs, m, n) and R as (runs, m, m) with rows that are not valid made harmless: 0, 0, unit.

    Raises ValueError when y or H have not the layout's rows.
    """
    m = layout.rows
    if y.shape[-1] != m or H.shape[-2] != m:
        raise ValueError(f"{layout.names} have {m} rows in all, but y has {y.shape[-1]} and H {H.shape[-2]}")
    if valid is not None and not valid.all():
        y = np.where(valid, y, 0.0)
        H = np.where(valid[:, :, None], H, 0.0)
    return y, H, noise(R, valid)


def noise(R: Array, valid: Mask | None) -> Array:
    """R (m,), (runs, m) or (runs, m, m) as (runs, m, m), a leading 1 for all runs; unit where a row is not valid."""
    eye = kalman.identity(R.shape[-1])
    full = R.ndim == 3
    if valid is not None and not valid.all():
        R = np.where(valid[:, :, None] & valid[:, None, :], R, eye) if full else np.where(valid, R, 1.0)
    return np.asarray(R if full else np.atleast_2d(R)[:, :, None] * eye)


def _subset_inverses(S: Array, whitener: Array, layout: Layout) -> Array:
    """G_A (..., 2^s, m, m) of S (..., m, m); `whitener`: L^-1 of the subsystems' own blocks, (..., m, m).

    With G of the subsets of the first rows and the new block's C = S_bA G and Schur complement D = S_bb - C S_Ab,
    the inverse with the block is [G + C' D^-1 C, -C' D^-1; -D^-1 C, D^-1]; for the block alone it is that of S_bb.
    """
    m = layout.rows
    alone = whitener.swapaxes(-1, -2) @ whitener
    G = np.zeros((*S.shape[:-2], 2 ** len(layout.sizes), m, m))
    for i, b in enumerate(layout.slices):
        G[..., 2**i, b, b] = alone[..., b, b]
        if i == 0:
            continue
        A, old, new = slice(0, b.start), slice(1, 2**i), slice(2**i + 1, 2 ** (i + 1))
        G_old = G[..., old, A, A]
        C = S[..., None, b, A] @ G_old
        L_inv = kalman.triangular_inverse(kalman.cholesky(S[..., None, b, b] - C @ S[..., None, A, b]))
        reach, transposed = L_inv @ C, L_inv.swapaxes(-1, -2)
        G[..., new, A, A] = G_old + reach.swapaxes(-1, -2) @ reach
        across = np.negative(transposed @ reach)
        G[..., new, b, A] = across
        G[..., new, A, b] = across.swapaxes(-1, -2)
        G[..., new, b, b] = transposed @ L_inv
    return G


def _of_driver(log_likelihood: Array, chosen: Ints) -> Array:
    """The driver's log-likelihood under each model, (runs, M); 0, which changes nothing, where there is no driver."""
    drives = np.arange(log_likelihood.shape[-1]) == chosen[:, None]
    return np.asarray(np.where(drives[:, None], log_likelihood, 0.0).sum(axis=-1))


@lru_cache(maxsize=64)
def _members(s: int) -> Mask:
    table = np.asarray((np.arange(2**s)[:, None] >> np.arange(s)) & 1 == 1)
    table.flags.writeable = False
    return table


@lru_cache(maxsize=64)
def _slices(sizes: tuple[int, ...]) -> tuple[slice, ...]:
    ends = np.cumsum(sizes).tolist()
    return tuple(slice(end - size, end) for end, size in zip(ends, sizes, strict=True))


@lru_cache(maxsize=64)
def _own_blocks(sizes: tuple[int, ...]) -> Array:
    table = _membership(sizes).T @ _membership(sizes)
    table.flags.writeable = False
    return table


@lru_cache(maxsize=64)
def _membership(sizes: tuple[int, ...]) -> Array:
    table = np.repeat(np.eye(len(sizes)), sizes, axis=1)
    table.flags.writeable = False
    return table


@lru_cache(maxsize=64)
def _places(sizes: tuple[int, ...]) -> Ints:
    table = np.full((len(sizes), max(sizes)), sum(sizes))
    for i, (end, size) in enumerate(zip(np.cumsum(sizes), sizes, strict=True)):
        table[i, :size] = np.arange(end - size, end)
    table.flags.writeable = False
    return table
