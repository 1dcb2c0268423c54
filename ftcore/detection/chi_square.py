"""Chi-square tests: of a filter's innovation, of two estimates against each other, and of a measurement against a
propagator that did not take it in.

All are the squared norm of a whitened vector, chi-square while nothing has failed, against `threshold(p_fa, dof)`.
Shapes lead with runs: (runs, n) states, (runs, n, n) covariances; a leading 1 is common to all runs.
Sources: H.G. Zhang and H.Y. Zhang (1992), (40)-(57); R. Da, Failure detection of dynamical systems with the state
chi-square test, J. Guidance 17 (1994); C. Yang, A. Mohammadi and Q.-W. Chen, Sensors 16 (2016), section 3.2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import overload

import numpy as np
from scipy.stats import chi2

from ftcore.detection.result import Array, Ints, Mask, TestResult
from ftcore.estimation import kalman
from ftcore.estimation.kalman import Innovation

RANK_TOLERANCE = 1e-4
"""A direction counts in the state test when the measurements took this part of its variance away."""

_TABLE_SIZE = 1024


@overload
def threshold(p_fa: float, dof: int) -> float: ...
@overload
def threshold(p_fa: float, dof: Ints) -> Array: ...
def threshold(p_fa: float, dof: int | Ints) -> float | Array:
    """The value that a chi-square variable on `dof` degrees of freedom exceeds with probability `p_fa`.

    `dof` of any shape, 0 included (threshold 0: the variable is 0 for certain). Looked up in a table, made once for a
    `p_fa`, of `scipy.stats.chi2.isf`. Raises ValueError for a p_fa outside (0, 1) or for a negative dof.
    Source: (49) and (57).
    """
    table = _thresholds(p_fa)
    least = dof if isinstance(dof, int) else dof.min(initial=0)
    if least < 0:
        raise ValueError(f"degrees of freedom cannot be negative; got {least}")
    try:
        found = table[dof]
    except IndexError:
        found = np.where(np.equal(dof, 0), 0.0, chi2.isf(p_fa, np.maximum(dof, 1)))
    return float(found) if isinstance(dof, int) else np.asarray(found)


def decide(statistic: Array, dof: Ints, p_fa: float) -> tuple[Ints, Array, Mask]:
    """Degrees of freedom and threshold broadcast to the statistic's shape, and the alarm; none where dof is 0."""
    if dof.shape != statistic.shape:
        dof = np.broadcast_to(dof, statistic.shape)
    limit = threshold(p_fa, dof)
    return dof, limit, (statistic >= limit) & (dof > 0)


def residual_test(inn: Innovation, p_fa: float, subject: str, name: str = "residual") -> TestResult:
    """Test a filter's innovation: lambda = r' V^-1 r, on as many degrees of freedom as there are valid rows.

    `inn` with leading axes (runs,): a `kalman.Innovation` or `Update`. Source: (53)-(57).
    """
    statistic = inn.statistic
    dof, limit, alarm = decide(statistic, inn.dof, p_fa)
    return TestResult(name, subject, statistic, dof, limit, alarm, inn.innovation, inn.covariance)


def residual_tests(
    inn: Innovation, p_fa: float, subjects: Sequence[str], name: str = "residual"
) -> tuple[TestResult, ...]:
    """`residual_test` for a bank of filters at once: `inn` leads with (runs, bank), `subjects` names the bank."""
    statistic = inn.statistic
    if statistic.shape[-1] != len(subjects):
        raise ValueError(f"{statistic.shape[-1]} filters in the bank, but {len(subjects)} subjects: {list(subjects)}")
    dof, limit, alarm = decide(statistic, inn.dof, p_fa)
    nu, S = inn.innovation, inn.covariance
    return tuple(
        TestResult(name, s, statistic[:, i], dof[:, i], limit[:, i], alarm[:, i], nu[:, i], S[:, i])
        for i, s in enumerate(subjects)
    )


def state_chi_square(
    x1: Array, P1: Array, x2: Array, P2: Array, p_fa: float, subject: str, name: str = "state"
) -> TestResult:
    """Test an estimate x1 against one, x2, that lacks its measurements: beta = x1 - x2, lambda = beta' W^-1 beta.

    W = P2 - P1 (50), which holds when x1 is the optimal filter and both began with the same estimate and covariance;
    for filters with inflated noise W is too large and the test conservative, so give it filters that are not. W has
    only the rank that the measurements reached: it is scaled by the diagonal of P2, so that an eigenvalue is the part
    of a direction's variance that the measurements took away, and directions below `RANK_TOLERANCE` are left out.
    `dof` is that rank, 0 (and no alarm) while x1 has learned nothing. `extra["eigenvalues"]`: all, (runs, n), rising.
    Shapes: x (runs, n), P (runs, n, n). Source: (40)-(52).
    """
    beta, W = x1 - x2, P2 - P1
    variance = np.diagonal(P2, axis1=-2, axis2=-1)
    # A state that no measurement reached in any run has a row of zeros, an eigenvalue that need not be computed.
    gained = np.diagonal(W, axis1=-2, axis2=-1)
    reached = np.flatnonzero((gained != 0.0).reshape(-1, gained.shape[-1]).any(axis=0))
    among = W[..., reached[:, None], reached]
    statistic, rank, eigenvalues = by_rank(beta[..., reached], among, variance[..., reached])
    dof, limit, alarm = decide(statistic, rank, p_fa)
    return TestResult(name, subject, statistic, dof, limit, alarm, beta, W, {"eigenvalues": eigenvalues})


def by_rank(beta: Array, W: Array, variance: Array) -> tuple[Array, Ints, Array]:
    """beta' W^-1 beta (...), where W is known: beta (..., n), W (..., n, n), `variance` (..., n) to count it in.

    Returns the statistic, how many directions of W count, (...), and all its scaled eigenvalues; `state_chi_square`.
    """
    scale = 1.0 / np.sqrt(np.where(variance > 0.0, variance, np.inf))
    eigenvalues, V = np.linalg.eigh(W * (scale[..., :, None] * scale[..., None, :]))
    known = eigenvalues > RANK_TOLERANCE
    whitened = np.vecmat(beta * scale, V) / np.sqrt(np.where(known, eigenvalues, np.inf))
    return np.asarray(np.vecdot(whitened, whitened)), np.asarray(known.sum(axis=-1)), eigenvalues


@dataclass(frozen=True, slots=True)
class Propagators:
    """Two estimates that only time carries on: x (runs, 2, n), P (runs, 2, n, n).

    They take turns: the one that was reset longer ago is the reference of the test, and it is the next to be reset. So
    a fault that slips into the fused estimate before it is noticed cannot reach the reference at once.
    """

    x: Array
    P: Array
    reference: Ints
    """Which of the two is the reference, (runs,): 0 or 1."""

    def estimate(self) -> tuple[Array, Array]:
        """The reference's x (runs, n) and P (runs, n, n)."""
        second = self.reference == 1
        return (
            np.where(second[:, None], self.x[:, 1], self.x[:, 0]),
            np.where(second[:, None, None], self.P[:, 1], self.P[:, 0]),
        )


def start_propagators(x: Array, P: Array) -> Propagators:
    """Both propagators at x (runs, n), P (runs, n, n), the first the reference: Step 1 of section 3.2."""
    return Propagators(
        np.stack([x, x], axis=1), np.stack([P, P], axis=1), np.zeros(max(len(x), len(P)), dtype=np.int64)
    )


def propagate(pair: Propagators, Phi: Array, Q: Array) -> Propagators:
    """Carry both over one step with Phi and Q (runs, n, n)."""
    x, P = kalman.predict(pair.x, pair.P, Phi[:, None], Q[:, None])
    return replace(pair, x=x, P=P)


def alternate(pair: Propagators, x: Array, P: Array, where: Mask | None = None) -> Propagators:
    """Reset the reference to the fused estimate x (runs, n), P (runs, n, n), and make the other one the reference.

    Called once a reset period. `where` (runs,): only in these runs, so that a fused estimate under suspicion is not
    taken over. The reference is never one that was just reset. Source: Step 4 of section 3.2.
    """
    due = np.stack([pair.reference == 0, pair.reference == 1], axis=1)
    turned = 1 - pair.reference
    if where is not None:
        due = due & where[:, None]
        turned = np.where(where, turned, pair.reference)
    return Propagators(
        np.where(due[:, :, None], x[:, None], pair.x),
        np.where(due[:, :, None, None], P[:, None], pair.P),
        turned,
    )


def two_propagator_test(
    pair: Propagators,
    y: Array,
    H: Array,
    R: Array,
    p_fa: float,
    subject: str,
    valid: Mask | None = None,
    name: str = "two-propagator",
) -> TestResult:
    """Test a measurement against the reference propagator: q = r' S^-1 r, r = y - H x_S, S = H P_S H' + R.

    Exactly chi-square on the valid rows. It equals (12), q = (x_KF - x_S)' (P_S - P_KF)^-1 (x_KF - x_S), when x_KF is
    the update of x_S: then x_KF - x_S = K r and P_S - P_KF = K S K' has the rank of the measurement, which is why a
    15-state paper uses thresholds for three. The form with an x_KF of any other origin is `state_chi_square(x_KF, P_KF,
    *pair.estimate(), ...)`. Shapes as in `kalman.innovation`, with leading (runs,).
    """
    x_S, P_S = pair.estimate()
    return residual_test(kalman.innovation(x_S, P_S, y, H, R, valid), p_fa, subject, name)


@lru_cache(maxsize=64)
def _thresholds(p_fa: float) -> Array:
    if not 0.0 < p_fa < 1.0:
        raise ValueError(f"the false-alarm probability must lie between 0 and 1, not {p_fa}")
    table = np.zeros(_TABLE_SIZE)
    table[1:] = chi2.isf(p_fa, np.arange(1, _TABLE_SIZE))
    table.flags.writeable = False
    return table
