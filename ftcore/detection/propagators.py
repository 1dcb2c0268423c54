"""Every subsystem against the reference propagator at once, and the validity that the fusion takes from it.

The two propagators (`ftcore.detection.chi_square.Propagators`) are carried on by time alone; the older of them is the
reference. A subsystem's detection value q is chi-square on its own rows while nothing has failed, in two forms.

*Innovation*: q = r' S^-1 r, r = z - H x_S, S = H P_S H' + R, with the reference's x_S and P_S. Exactly chi-square, and
equal to (12) when the update x_KF starts from x_S: then x_KF - x_S = K r and P_S - P_KF = K S K' has the rank of the
measurement, which is why the paper's thresholds 6.25 and 11.35 are those of three degrees of freedom among 15 states.

*State*: (12) itself, with x_KF the local IMM's update of the *fused* prediction, on the subsystem's own components,
q = d' W^-1 d, d = H (x_KF - x_S), W = H (P_S - P_KF) H'. A fault moves x_KF by the gain only, so it is seen later.

Between two thresholds the validity beta falls from 1 to 0, (15).
Source: C. Yang, A. Mohammadi and Q.-W. Chen, Sensors 16 (2016), sections 3.2 and 3.3.
"""

from dataclasses import dataclass, replace

import numpy as np

from ftcore.detection.chi_square import Propagators, state_chi_square, threshold
from ftcore.detection.result import Array, Ints, Mask, TestResult
from ftcore.estimation import imm, kalman
from ftcore.estimation.tolerant_fusion import Layout, SubsetUpdates, stacked

P_SUSPECT, P_REJECT = 0.10, 0.01
"""Tail probabilities of the two thresholds; for three rows they are the paper's 6.25 and 11.35 (11.345)."""


@dataclass(frozen=True, slots=True)
class SubsystemTests:
    """What the reference propagator says of every subsystem."""

    layout: Layout
    q: Array
    """Detection values, (runs, s); 0 for a subsystem without a valid row."""
    dof: Ints
    """Degrees of freedom of q, (runs, s); 0 where there was nothing to judge."""
    present: Mask
    """Subsystems with a valid row, (runs, s)."""
    suspect: Array
    """The lower threshold, (runs, s): up to here a subsystem is believed."""
    reject: Array
    """The upper one, (runs, s): beyond it the subsystem is not believed, and this is the alarm."""
    beta: Array
    """Validity, (runs, s): 1 to `suspect`, 0 from `reject` on, and 0 for a subsystem without a valid row."""
    vector: Array
    """What q is made of, (runs, m): r, or d."""
    covariance: Array
    """Its covariance without a fault, (runs, m, m); only blocks of one subsystem mean anything."""

    @property
    def alarm(self) -> Mask:
        """Subsystems rejected, (runs, s)."""
        return (self.q > self.reject) & (self.dof > 0)

    def results(self, name: str = "two-propagator") -> tuple[TestResult, ...]:
        """The same, a `TestResult` a subsystem; its validity is in `extra["beta"]`, `suspect` beside it."""
        alarm = self.alarm
        return tuple(
            TestResult(
                name,
                subject,
                self.q[:, i],
                self.dof[:, i],
                self.reject[:, i],
                alarm[:, i],
                self.vector[:, rows],
                self.covariance[:, rows, rows],
                {"beta": self.beta[:, i], "suspect": self.suspect[:, i]},
            )
            for i, (subject, rows) in enumerate(zip(self.layout.names, self.layout.slices, strict=True))
        )


def validity(q: Array, suspect: Array, reject: Array) -> Array:
    """beta of (15): 1 up to `suspect`, falling linearly to 0 at `reject`; any shapes that broadcast."""
    return np.asarray(np.clip((reject - q) / np.maximum(reject - suspect, np.finfo(float).tiny), 0.0, 1.0))


def carry(pair: Propagators, Phi: Array, Q: Array, mu: Array) -> Propagators:
    """Carry both propagators over one step of an IMM's prediction.

    Phi (runs, n, n), common to the models, Q (runs, M, n, n), mu (runs, M) their predicted mode probabilities, or
    (runs, 2, M) when each propagator has its own. Interaction leaves the combined mean and covariance alone, and with
    one Phi the combined prediction is P <- Phi P Phi' + sum_j mu_j Q_j: a propagator need not hold a state a model.
    Source: (7)-(10).
    """
    n = Q.shape[-1]
    weights = mu[:, None] if mu.ndim == 2 else mu
    noise = (weights @ Q.reshape(*Q.shape[:2], n * n)).reshape(-1, weights.shape[1], n, n)
    x, P = kalman.predict(pair.x, pair.P, Phi[:, None], noise)
    return replace(pair, x=x, P=P)


def feed_back(pair: Propagators, dx: Array) -> Propagators:
    """The SINS was corrected by dx (runs, n): what both propagators hold of its errors becomes smaller by dx."""
    return replace(pair, x=pair.x - dx[:, None])


def renew(pair: Propagators, x: Array, P: Array, where: Mask) -> Propagators:
    """Reset both propagators to x (runs, n), P (runs, n, n) in the runs `where` (runs,): the reference was wrong."""
    if not where.any():
        return pair
    return replace(
        pair,
        x=np.where(where[:, None, None], x[:, None], pair.x),
        P=np.where(where[:, None, None, None], P[:, None], pair.P),
    )


def innovation_tests(
    pair: Propagators,
    y: Array,
    H: Array,
    R: Array,
    layout: Layout,
    valid: Mask | None = None,
    p_suspect: float = P_SUSPECT,
    p_reject: float = P_REJECT,
) -> SubsystemTests:
    """q of every subsystem in the innovation form.

    y (runs, m), H (runs, m, n), R and `valid` as in `tolerant_fusion.subset_updates`. The thresholds are those that a
    chi-square variable on the subsystem's valid rows exceeds with probability `p_suspect` and `p_reject`. Raises
    ValueError unless 0 < p_reject < p_suspect < 1.
    """
    x_S, P_S = pair.estimate()
    y, H, R = stacked(y, H, R, layout, valid)
    # Without the blocks between subsystems, one factor whitens each of them by itself.
    S = (H @ P_S @ H.swapaxes(-1, -2) + R) * (layout.membership.T @ layout.membership)
    r = y - np.matvec(H, x_S)
    whitened = np.matvec(kalman.triangular_inverse(kalman.cholesky(S)), r)
    q = np.square(whitened) @ layout.membership.T
    dof = np.array(layout.sizes)[None] if valid is None else layout.count(valid)
    return _judged(q, dof, dof > 0, r, S, layout, p_suspect, p_reject)


def state_tests(
    pair: Propagators, updates: SubsetUpdates, p_suspect: float = P_SUSPECT, p_reject: float = P_REJECT
) -> SubsystemTests:
    """q of every subsystem in the state form, (12).

    `updates`: those of the fused prediction; a subsystem's x_KF is the combination of the models' updates with it
    alone, weighed by the mode probabilities that its own likelihood gives, as in its local IMM filter.
    W counts in the directions in which x_KF knows more than the reference: dof is how many. Where it is 0 there is
    nothing to hold against the subsystem, and it is believed.
    """
    x_S, P_S = pair.estimate()
    layout, prior = updates.layout, updates.prior
    s, rows = len(layout.sizes), layout.places

    def room(A: Array, *axes: int) -> Array:
        """A smaller subsystem's block is filled up with zeros, of which W has no variance: they do not count."""
        return A if rows.max() < layout.rows else np.pad(A, [(0, int(k - A.ndim in axes)) for k in range(A.ndim)])

    H = room(updates.H, -2)[:, rows]
    i, j = rows[:, :, None], rows[:, None, :]
    C = room(updates.HPH, -2, -1)[:, :, i, j]
    alone = 2 ** np.arange(s)
    u = room(updates.weighed, -1)[:, :, alone[:, None], rows]
    G = room(updates.inverse, -2, -1)[:, :, alone[:, None, None], i, j]
    local = imm.Mixture(
        np.moveaxis(np.matvec(H[:, None], prior.x[:, :, None]) + np.matvec(C, u), 1, 2),
        np.moveaxis(kalman.symmetric(C - C @ G @ C), 1, 2),
        imm.reweigh(prior.log_mu[:, None], updates.log_likelihood.swapaxes(1, 2)),
    )
    x_KF, P_KF = imm.combine(local)
    Hx_S = np.matvec(H, x_S[:, None])
    HPH_S = kalman.symmetric(H @ P_S[:, None] @ H.swapaxes(-1, -2))
    test = state_chi_square(x_KF, P_KF, Hx_S, HPH_S, p_reject, "all")
    present = updates.dof > 0
    q, dof = np.where(present, test.statistic, 0.0), np.where(present, test.dof, 0)
    d = np.zeros((len(q), layout.rows))
    W = np.zeros((len(q), layout.rows, layout.rows))
    for k, (size, own) in enumerate(zip(layout.sizes, layout.slices, strict=True)):
        d[:, own] = (x_KF - Hx_S)[:, k, :size]
        W[:, own, own] = (HPH_S - P_KF)[:, k, :size, :size]
    return _judged(q, dof, present, d, W, layout, p_suspect, p_reject)


def _judged(
    q: Array,
    dof: Ints,
    present: Mask,
    vector: Array,
    covariance: Array,
    layout: Layout,
    p_suspect: float,
    p_reject: float,
) -> SubsystemTests:
    if not p_reject < p_suspect:
        raise ValueError(f"a subsystem is suspected before it is rejected: {p_suspect} is not above {p_reject}")
    dof, present = np.broadcast_to(dof, q.shape), np.broadcast_to(present, q.shape)
    suspect, reject = threshold(p_suspect, dof), threshold(p_reject, dof)
    beta = np.where(present, np.where(dof > 0, validity(q, suspect, reject), 1.0), 0.0)
    return SubsystemTests(layout, q, dof, present, suspect, reject, beta, vector, covariance)
