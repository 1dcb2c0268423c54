"""Every subsystem against the reference propagator at once, and the validity that the fusion takes from it.

The two propagators (`ftcore.detection.chi_square.Propagators`) are carried on by time alone; the older of them is the
reference. A subsystem's detection value q is chi-square on its own rows while nothing has failed, in two forms.

*Innovation*: q = r' S^-1 r, r = z - H x_S, S = H P_S H' + R, with the reference's x_S and P_S. Chi-square exactly while
the reference's model is the truth's, and equal to (12) when the update x_KF starts from x_S: then x_KF - x_S = K r and
P_S - P_KF = K S K' has the rank of the measurement, which is why the paper's thresholds 6.25 and 11.35 are those of
three degrees of freedom among 15 states.

*State*: (12) itself, with x_KF the local IMM's update of the *fused* prediction, on the subsystem's own components,
q = d' W^-1 d, d = H (x_KF - x_S), W = H (P_S - P_KF) H'. A fault moves x_KF by the gain only, so it is seen later.

Between two thresholds the validity beta falls from 1 to 0, (15).
Source: C. Yang, A. Mohammadi and Q.-W. Chen, Sensors 16 (2016), sections 3.2 and 3.3.
"""

from dataclasses import dataclass, replace

import numpy as np

from ftcore.detection.chi_square import Propagators, by_rank, threshold
from ftcore.detection.result import Array, Ints, Mask, TestResult
from ftcore.estimation import imm, kalman
from ftcore.estimation.tolerant_fusion import Layout, Residuals, SubsetUpdates, residuals

P_SUSPECT, P_REJECT = 0.10, 0.01
"""Tail probabilities of the two thresholds; for three rows they are the paper's 6.25 and 11.35 (11.345)."""

_TINY = float(np.finfo(float).tiny)


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
    falling = (reject - q) / np.maximum(reject - suspect, _TINY)
    return np.asarray(np.minimum(np.maximum(falling, 0.0), 1.0))


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
    return judge(residuals(x_S[:, None], P_S[:, None], y, H, R, layout, valid), 0, p_suspect, p_reject)


def judge(r: Residuals, reference: int, p_suspect: float = P_SUSPECT, p_reject: float = P_REJECT) -> SubsystemTests:
    """`innovation_tests` out of residuals that are there: `reference` is the place of the reference's among them."""
    q, nu, S = r.q[:, reference], r.nu[:, reference], r.S[:, reference]
    return _judged(q, r.dof, r.dof > 0, nu, S, r.layout, p_suspect, p_reject)


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
    r, prior = updates.residuals, updates.prior
    layout, H = updates.layout, r.H[:, None]
    # The local filters' updates on what they measure, less H x_S: H (x - x_S) + C D^-1 nu, and C - C D^-1 C.
    C = r.HPH * layout.own_blocks
    reach = r.whitener @ C
    z = np.matvec(H, prior.x - x_S[:, None]) + np.vecmat(r.whitened, reach)
    V = C - reach.swapaxes(-1, -2) @ reach
    # Combined, each subsystem by its own mode probabilities: the weight of every row, (runs, M, m).
    mu = np.exp(imm.reweigh(prior.log_mu[:, :, None], updates.log_likelihood, axis=1)) @ layout.membership
    d = (mu * z).sum(axis=1)
    spread = (z - d[:, None]) * np.sqrt(mu)
    HPH_S = kalman.symmetric(r.H @ P_S @ r.H.swapaxes(-1, -2))
    W = HPH_S - (mu[..., None] * V).sum(axis=1) - spread.swapaxes(-1, -2) @ spread
    q, dof, _ = by_rank(*_of_subsystems(d, W, np.diagonal(HPH_S, axis1=-2, axis2=-1), layout))
    return _judged(q, dof, updates.dof > 0, d, W, layout, p_suspect, p_reject)


def _of_subsystems(d: Array, W: Array, variance: Array, layout: Layout) -> tuple[Array, Array, Array]:
    """The subsystems' parts of d (runs, m), W (runs, m, m) and variances (runs, m), with (runs, s, largest size).

    A smaller subsystem's part is filled up with zeros: directions of no variance do not count.
    """
    rows = layout.places
    if rows.max() == layout.rows:
        d, variance = (np.pad(v, [(0, 0), (0, 1)]) for v in (d, variance))
        W = np.pad(W, [(0, 0), (0, 1), (0, 1)])
    return d[:, rows], W[:, rows[:, :, None], rows[:, None, :]], variance[:, rows]


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
    if dof.shape != q.shape or present.shape != q.shape:
        dof, present = np.broadcast_to(dof, q.shape), np.broadcast_to(present, q.shape)
    suspect, reject = threshold(p_suspect, dof), threshold(p_reject, dof)
    beta = np.where(present, np.where(dof > 0, validity(q, suspect, reject), 1.0), 0.0)
    return SubsystemTests(layout, q, dof, present, suspect, reject, beta, vector, covariance)
