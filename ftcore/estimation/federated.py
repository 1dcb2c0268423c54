"""A federation of local Kalman filters and the master that fuses them.

Everything here rests on two facts about information (inverse covariance), and each mode is a way of using them.

*Merge.* Estimates with independent errors add their information: Theorem 1, equations (9)-(10),

    P_g = (sum_i P_i^-1)^-1,      x_g = P_g sum_i P_i^-1 x_i.

*Split.* One estimate may be handed to several filters as if their errors were independent, if each is told a larger
covariance: with shares b_i = 1/r_i > 0 and sum b_i <= 1,

    [Q ... Q; ...; Q ... Q] <= diag(r_1 Q, ..., r_N Q),                                    (27)-(28)

so noise or an estimate that all share is split into parts that a merge puts together again: sum (r_i P)^-1 = P^-1.
Process noise is split in every step, (29)-(31), therefore the filters never need each other's covariance. (28) as
printed also admits 1/r_i = 0, an infinite Q; that is refused here.

The modes differ in what is split again after the merge, and by whom it is held.

`no-reset`
    Nothing. The local filters go on alone; the paper's own way. The fused P is a bound, not exact. A filter that is not
    used contributes nothing, (11)-(12), nor can it harm another.
`fusion-reset`
    Everything: x_i <- x_g, P_i <- r_i P_g. The inverses of r_i Phi P_g Phi' + r_i Q add up to the inverse of the
    prediction of P_g, so the merge of locals that each took their own measurement is the centralised filter, process
    noise included. A filter that is not used contributes its prediction in place of its estimate: only its measurement
    is withheld, no prior information is lost.
`zero-reset`
    The master holds everything, the locals nothing: each is the master's prediction with its own measurement taken in,
    and contributes what that added, P_i^-1 - (P_g^-)^-1. Also the centralised filter.
`rescale`
    Each local keeps its estimate and, in every direction, at most its share b_i of what all know together; the master
    takes the rest over into a share of its own, which then merges with the locals. Information may be split by matrices
    as well as by numbers, [P P; P P] <= diag(A, B) whenever A^-1 + B^-1 <= P^-1, so the bound holds. Carlson scales a
    local by one number, P_i / c_i. One number must either leave the master without anything in the directions that no
    local knows well, or let a local forget, by c_i in every epoch, what its own sensor does not see.

A filter that was contaminated comes back (`readmitted`) by a fusion reset of it and of all that are used, in any mode:
giving x_g to it alone would count the same information twice.

Shapes: x (runs, N, n), P (runs, N, n, n), Q and Phi (runs, n, n); a leading 1 broadcasts. A `Bank` holds N locals and,
last, the master: (runs, N + 1, ...). States may differ in units by many orders: matrices are brought to unit diagonal
before they are inverted. Source: H.G. Zhang and H.Y. Zhang (1992); N.A. Carlson, Federated square root filter for
decentralized parallel processes, IEEE Trans. AES 26 (1990).
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftcore.estimation import kalman
from ftcore.estimation.kalman import Array, Mask, cholesky, spd_inverse, symmetric, triangular_inverse

Mode = Literal["no-reset", "fusion-reset", "zero-reset", "rescale"]
MODES: tuple[Mode, ...] = get_args(Mode)
Criterion = Literal["trace", "determinant"]
T = TypeVar("T", bound=np.generic)

_SECTIONS, _CUTS = 16, 6


@dataclass(frozen=True, slots=True)
class Estimate:
    """A state and its covariance: x (runs, n), P (runs, n, n)."""

    x: Array
    P: Array


@dataclass(frozen=True, slots=True)
class Bank:
    """N local filters and, in the last place, the master: x (runs, N + 1, n), P (runs, N + 1, n, n).

    The master's place holds its share in `rescale`, and the whole fused estimate in the other modes (where only
    `zero-reset` fuses from it; in the others it is there to predict with: a failed sensor's output, an admission test).
    """

    x: Array
    P: Array

    @property
    def locals(self) -> tuple[Array, Array]:
        """The local filters' x (runs, N, n) and P (runs, N, n, n)."""
        return self.x[:, :-1], self.P[:, :-1]

    @property
    def master(self) -> Estimate:
        """What stands in the master's place."""
        return Estimate(self.x[:, -1], self.P[:, -1])


@dataclass(frozen=True, slots=True)
class Sharing:
    """How a federation shares information: the mode, the locals' shares 1/r_i, and the master's (`rescale` only).

    Raises ValueError when a share is not positive or when they sum to more than one, with the values.
    """

    mode: Mode
    shares: tuple[float, ...]
    master_share: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what breaks (28)."""
        if self.mode not in MODES:
            raise ValueError(f"federation mode {self.mode!r} is unknown; choose one of {', '.join(MODES)}")
        if self.mode == "rescale":
            if not 0.0 < self.master_share < 1.0:
                raise ValueError(f"in rescale mode the master holds a share between 0 and 1, not {self.master_share}")
            inflation_factors((*self.shares, self.master_share))
            return
        if self.master_share != 0.0:
            raise ValueError(f"the master holds a share of its own only in rescale mode, not in {self.mode}")
        inflation_factors(self.shares)

    @classmethod
    def equal(cls, mode: Mode, count: int) -> "Sharing":
        """Equal shares for `count` local filters (and the master, in `rescale`)."""
        if mode == "rescale":
            share = 1.0 / (count + 1)
            return cls(mode, (share,) * count, share)
        return cls(mode, (1.0 / count,) * count)


def inflation_factors(shares: ArrayLike) -> Array:
    """Inflation r_i = 1 / share of each filter's process noise and initial covariance, (N,).

    Raises ValueError unless every share is positive and finite and their sum is at most 1 (to 1e-9).
    Source: (27)-(28); a share of zero, which (28) admits, would make Q infinite.
    """
    b = np.asarray(shares, dtype=float)
    if b.ndim != 1 or b.size == 0:
        raise ValueError(f"shares are one number a filter, at least one; got an array of shape {b.shape}")
    if not np.all(np.isfinite(b)) or np.any(b <= 0.0):
        raise ValueError(f"every share 1/r_i must be positive (zero means infinite process noise); got {b.tolist()}")
    if b.sum() > 1.0 + 1e-9:
        raise ValueError(
            f"the shares 1/r_i may sum to 1 at most, else the bound (27) fails; {b.tolist()} sum to {b.sum():g}"
        )
    return 1.0 / b


def redistribute(shares: ArrayLike, used: Mask) -> Array:
    """Inflation factors (runs, N) when only some filters are used: the shares of those are scaled to sum to one.

    `used` (runs, N). A filter that is not used keeps the factor of its own share: alone, it still bounds itself. The
    bound (29) holds for any shares in any step, so they may change from step to step; but a filter that was left out
    while others took its share must come back by a fusion reset (`after_fusion`, `readmitted`). Raises as
    `inflation_factors`. Source: (27)-(31).
    """
    return _redistribute(inflation_factors(shares), used)


def inflate(P: Array, r: Array) -> Array:
    """One covariance for each filter: r_i P, from P (runs, n, n) and r (runs, N) or (N,), as (runs, N, n, n)."""
    return r[..., None, None] * P[..., None, :, :]


def fuse(x: Array, P: Array, used: Mask, fallback: Estimate | None = None) -> Estimate:
    """Merge the used local estimates into the global one.

    Shapes: x (runs, N, n), P (runs, N, n, n), used (runs, N). A run in which nothing is used returns `fallback`;
    raises ValueError when there is such a run and no fallback, or when a used variance is not positive, and LinAlgError
    when a used covariance is not positive definite. Source: (9)-(10), and (11)-(12) with a filter left out.
    """
    return _merge(x, P, used.astype(np.float64), fallback)


def covariance_intersection(
    x: Array,
    P: Array,
    used: Mask,
    criterion: Criterion = "determinant",
    fallback: Estimate | None = None,
) -> Estimate:
    """Fuse estimates whose correlation is unknown: P_g^-1 = sum w_i P_i^-1 with weights w_i >= 0 that sum to one.

    Shapes and errors as in `fuse`. Two filters: the weight that minimises the determinant of P_g, or its trace with
    each state in units of the smaller standard deviation. More: the closed formulas of Franken and Huepper
    (determinant) and of Niehsen (trace), which need no search. Sources: S.J. Julier and J.K. Uhlmann (1997); D. Franken
    and A. Huepper, Improved fast covariance intersection for distributed data fusion (2005); W. Niehsen, Information
    fusion based on fast covariance intersection filtering (2002).
    """
    return _merge(x, P, intersection_weights(P, used, criterion), fallback)


def intersection_weights(P: Array, used: Mask, criterion: Criterion = "determinant") -> Array:
    """Weights of `covariance_intersection`, (runs, N): zero where a filter is not used, else they sum to one."""
    if criterion not in ("trace", "determinant"):
        raise ValueError(f"covariance intersection minimises the 'trace' or the 'determinant', not {criterion!r}")
    if not used.all():
        P = _quiet_unused(P, used)
    scale = _scale(P)
    P = P / (scale[:, None, :, None] * scale[:, None, None, :])
    if P.shape[1] == 2:
        first = np.where(used.all(axis=1), _weight_of_first(P[:, 0], P[:, 1], criterion), 1.0)
        return np.where(used, np.stack([first, 1.0 - first * used[:, 0]], axis=1), 0.0)
    w = used / np.trace(P, axis1=-2, axis2=-1) if criterion == "trace" else _franken_huepper(spd_inverse(P), used)
    total = w.sum(axis=1, keepdims=True)
    return np.asarray(w / np.where(total > 0.0, total, 1.0))


def failed_output(estimate: Estimate, H: Array) -> tuple[Array, Array]:
    """What a failed sensor would have read, H x_g (runs, m), and the covariance of that, H P_g H' (runs, m, m).

    H (runs, m, n). To judge a reading against it, add the reading's own R. Source: (13).
    """
    return np.matvec(H, estimate.x), H @ estimate.P @ H.swapaxes(-1, -2)


def start(x0: Array, P0: Array, sharing: Sharing, members: Mask | None = None) -> Bank:
    """A federation that together knows x0 (runs, n) with covariance P0 (runs, n, n), each filter its part of it.

    `members` (runs, N) as in `noise_factors`; everyone by default.
    """
    everyone = np.ones((1, len(sharing.shares)), dtype=bool)
    return _split(Estimate(x0, P0), noise_factors(sharing, everyone if members is None else members))


def noise_factors(sharing: Sharing, members: Mask) -> Array:
    """What the process noise of the coming step is multiplied by in every filter and in the master, (runs, N + 1).

    `members` (runs, N): filters that are part of the federation, that is, not isolated (one whose measurement is
    withheld for an epoch is still a member). A master without a share of its own has 1: it predicts honestly.
    """
    if sharing.mode == "zero-reset":
        return np.ones((1, len(sharing.shares) + 1))
    if sharing.mode == "rescale":
        return _redistribute(_factors((*sharing.shares, sharing.master_share)), _append(members, np.True_))
    r = _factors(sharing.shares)
    return _append(r[None] if sharing.mode == "fusion-reset" else _redistribute(r, members), np.float64(1.0))


def predict(bank: Bank, Phi: Array, Q: Array, sharing: Sharing, members: Mask) -> Bank:
    """Carry all filters and the master over one step, each with its part of the process noise.

    Phi and Q (runs, n, n); members as in `noise_factors`. Source: (24) and (29)-(31).
    """
    return Bank(*kalman.predict(bank.x, bank.P, Phi[:, None], inflate(Q, noise_factors(sharing, members))))


def master_estimate(
    prior: Bank, x: Array, P: Array, used: Mask, sharing: Sharing, fallback: Estimate | None = None
) -> Estimate:
    """The global estimate of this epoch.

    `prior`: the bank as `predict` left it. x (runs, N, n), P (runs, N, n, n): the locals after their measurements. used
    (runs, N): whose measurement is trusted; one that is not used contributes its prediction in fusion-reset, and
    nothing in the other modes. `fallback` is for runs with nothing to fuse, which only no-reset knows; by default it is
    the master's prediction. Source: (9)-(12), and the module's text for the modes.
    """
    if sharing.mode == "no-reset":
        return fuse(x, P, used, prior.master if fallback is None else fallback)
    if sharing.mode == "fusion-reset":
        if not used.all():
            x_prior, P_prior = prior.locals
            x = np.where(used[:, :, None], x, x_prior)
            P = np.where(used[:, :, None, None], P, P_prior)
        return _merge(x, P, np.ones((1, x.shape[1])), None)
    weights = used.astype(np.float64)
    # zero-reset: the prediction once, and what each used local added to it. rescale: the master's own share.
    own = 1.0 - weights.sum(axis=1) if sharing.mode == "zero-reset" else np.float64(1.0)
    return _merge(_append(x, prior.x[:, -1]), _append(P, prior.P[:, -1]), _append(weights, own), None)


def after_fusion(
    prior: Bank,
    x: Array,
    P: Array,
    fused: Estimate,
    used: Mask,
    sharing: Sharing,
    readmitted: Mask | None = None,
) -> Bank:
    """The bank that goes on into the next epoch, its information shared out again as the mode has it.

    Arguments as in `master_estimate`, with the estimate it gave. `readmitted` (runs, N): filters that come back now; in
    a run where there are any, they and all that are used are reset to the fused estimate, each with its share of it.
    """
    if sharing.mode in ("fusion-reset", "zero-reset"):
        return _split(fused, noise_factors(sharing, np.ones((1, x.shape[1]), dtype=bool)))
    if sharing.mode == "no-reset":
        bank = Bank(_append(x, fused.x), _append(P, fused.P))
    else:
        bank = _rescale(prior.master, x, P, fused, used, sharing)
    if readmitted is None or not readmitted.any():
        return bank
    together = used | readmitted
    reset = _append(together & readmitted.any(axis=1, keepdims=True), readmitted.any(axis=1))
    whole = _split(fused, noise_factors(sharing, together))
    return Bank(
        np.where(reset[:, :, None], whole.x, bank.x),
        np.where(reset[:, :, None, None], whole.P, bank.P),
    )


def _split(whole: Estimate, r: Array) -> Bank:
    """Hand one estimate to N + 1 filters with covariance r_i P: (27) for an estimate."""
    P = inflate(whole.P, r)
    return Bank(np.broadcast_to(whole.x[:, None], (whole.x.shape[0], *P.shape[1:3])), P)


def _rescale(master: Estimate, x: Array, P: Array, fused: Estimate, used: Mask, sharing: Sharing) -> Bank:
    """Each used local keeps its state and at most its share of information; the master takes over what is above.

    In the basis where P_g is unit, P_i has the eigenvalues mu_k: information 1 / mu_k of all that there is, 1. A local
    with 1 / mu_k > b_i is brought to 1 / b_i, the master gains 1 / mu_k - b_i.
    """
    scale = _scale(fused.P[:, None])
    L = cholesky(fused.P / (scale[:, :, None] * scale[:, None, :]))
    to_unit = triangular_inverse(L) / scale[:, None, :]
    from_unit = scale[:, :, None] * L
    mu, U = np.linalg.eigh(symmetric(to_unit[:, None] @ P @ to_unit.swapaxes(-1, -2)[:, None]))
    share = np.array(sharing.shares)[:, None]
    widened = np.where(used[:, :, None], np.maximum(1.0 / share - mu, 0.0), 0.0)
    taken = np.where(used[:, :, None], np.maximum(1.0 / mu - share, 0.0), 0.0)
    basis = from_unit[:, None] @ U
    P_new = symmetric(P + (basis * widened[:, :, None, :]) @ basis.swapaxes(-1, -2))
    information = (U * taken[:, :, None, :]) @ U.swapaxes(-1, -2)
    own = spd_inverse(symmetric(to_unit @ master.P @ to_unit.swapaxes(-1, -2)))
    z = np.matvec(information, np.matvec(to_unit[:, None], x - fused.x[:, None])).sum(axis=1)
    z = z + np.matvec(own, np.matvec(to_unit, master.x - fused.x))
    P_unit = spd_inverse(own + information.sum(axis=1))
    P_m = symmetric(from_unit @ P_unit @ from_unit.swapaxes(-1, -2))
    x_m = fused.x + np.matvec(from_unit, np.matvec(P_unit, z))
    return Bank(_append(x, x_m), _append(P_new, P_m))


def _merge(x: Array, P: Array, weights: Array, fallback: Estimate | None) -> Estimate:
    """P_g = (sum w_i P_i^-1)^-1, x_g = P_g sum w_i P_i^-1 x_i; a filter of weight 0 may hold anything, even NaN."""
    out = weights == 0.0
    if out.any():
        x = np.where(out[:, :, None], 0.0, x)
        P = _quiet_unused(P, ~out)
    scale = _scale(P)
    unit = scale[:, :, None] * scale[:, None, :]
    information = spd_inverse(P / unit[:, None])
    total = (weights[:, None, :] @ information.reshape(*information.shape[:2], -1)).reshape(-1, *unit.shape[1:])
    z = np.vecmat(weights, np.matvec(information, x / scale[:, None]))
    empty = out.all(axis=1)
    if empty.any():
        if fallback is None:
            raise ValueError(f"nothing to fuse in runs {np.flatnonzero(empty).tolist()}: give a fallback estimate")
        total = np.where(empty[:, None, None], np.eye(x.shape[-1]), total)
    P_g = spd_inverse(total)
    x_g, P_g = np.matvec(P_g, z) * scale, P_g * unit
    if fallback is not None and empty.any():
        x_g = np.where(empty[:, None], fallback.x, x_g)
        P_g = np.where(empty[:, None, None], fallback.P, P_g)
    return Estimate(x_g, P_g)


def _scale(P: Array) -> Array:
    """The smallest standard deviation of every state among the filters, (runs, n): the unit it is fused in."""
    variance = np.diagonal(P, axis1=-2, axis2=-1).min(axis=1)
    if not (variance > 0.0).all():
        states = np.flatnonzero(~(variance > 0.0).all(axis=0)).tolist()
        raise ValueError(
            f"estimates are fused by their information, so no variance may be 0 or negative: states {states}"
        )
    return np.asarray(np.sqrt(variance))


def _quiet_unused(P: Array, used: Mask) -> Array:
    """P with the unused filters' matrices replaced by a wide harmless one, so that they neither scale nor fail."""
    quiet = np.where(used[:, :, None, None], P, 0.0)
    variance = np.diagonal(quiet, axis1=-2, axis2=-1).max(axis=1)
    wide = np.where(variance > 0.0, variance, 1.0)[:, None, :, None] * np.eye(P.shape[-1])
    return np.where(used[:, :, None, None], P, wide)


def _weight_of_first(A: Array, B: Array, criterion: Criterion) -> Array:
    """The weight w of A that minimises det or trace of (w A^-1 + (1 - w) B^-1)^-1, (runs,).

    In the basis that makes A unit and B diagonal (values b_k), both are sums over k of g_k = w + (1 - w) / b_k: the
    slope is sum c_k (1 - 1/b_k) / g_k^p with p = 1, c = 1 for the determinant and p = 2, c_k the length of the basis
    vector for the trace. It falls with w, so its zero is found by cutting the interval into sixteenths, six times.
    """
    L = cholesky(A)
    L_inv = triangular_inverse(L)
    b, U = np.linalg.eigh(symmetric(L_inv @ B @ L_inv.swapaxes(-1, -2)))
    inverse_b = 1.0 / np.maximum(b, np.finfo(float).tiny)
    slope = 1.0 - inverse_b
    power = 1
    if criterion == "trace":
        slope = slope * np.square(L @ U).sum(axis=-2)
        power = 2
    low = np.zeros(A.shape[0])
    width = 1.0
    cuts = np.linspace(0.0, 1.0, _SECTIONS + 1)
    for _ in range(_CUTS):
        w = (low[:, None] + width * cuts)[:, :, None]
        g = w + (1.0 - w) * inverse_b[:, None]
        rising = (slope[:, None] / g**power).sum(axis=-1) > 0.0
        width /= _SECTIONS
        low = low + width * np.maximum(np.count_nonzero(rising[:, :-1], axis=1) - 1, 0)
    # What is left of the interval is 6e-8 wide; its ends matter where the optimum is one filter alone.
    return np.where(rising[:, -1], low + width, np.where(rising[:, 0], low + 0.5 * width, low))


def _franken_huepper(information: Array, used: Mask) -> Array:
    """Unnormalised weights |I| - |I - I_i| + |I_i|, as fractions of |I|, I the sum; (runs, N)."""
    information = information * used[:, :, None, None]
    total = information.sum(axis=1, keepdims=True)
    some = used.any(axis=1)
    total[~some] = np.eye(total.shape[-1])
    log_all = np.linalg.slogdet(total)[1]
    sign, log_others = np.linalg.slogdet(total - information)
    log_alone = np.linalg.slogdet(np.where(used[:, :, None, None], information, np.eye(total.shape[-1])))[1]
    others = np.where(sign > 0.0, np.exp(np.minimum(log_others - log_all, 0.0)), 0.0)
    alone = np.exp(np.minimum(log_alone - log_all, 0.0))
    return np.asarray(np.where(used, 1.0 - others + alone, 0.0))


def _redistribute(r: Array, used: Mask) -> Array:
    total = np.where(used, 1.0 / r, 0.0).sum(axis=-1, keepdims=True)
    return np.where(used, r * total, r)


@lru_cache(maxsize=64)
def _factors(shares: tuple[float, ...]) -> Array:
    r = inflation_factors(shares)
    r.flags.writeable = False
    return r


def _append(stack: NDArray[T], last: NDArray[T] | T) -> NDArray[T]:
    """One more filter behind those of a stack: (runs, N, ...) and (runs, ...) give (runs, N + 1, ...)."""
    last = np.asarray(last)
    runs = max(stack.shape[0], last.shape[0]) if last.ndim else stack.shape[0]
    out = np.empty((runs, stack.shape[1] + 1, *stack.shape[2:]), dtype=stack.dtype)
    out[:, :-1] = stack
    out[:, -1] = last
    return out
