"""No rejection for ever: subsystems that agree with each other against the reference are believed again.

A subsystem is judged by a reference that its peers made. A fault that grows too slowly to be noticed carries the fused
estimate, and one reset later the reference, away from the truth. When it ends, every sound subsystem disagrees with the
reference; nobody is believed, the inertial system flies on alone, each reset of a propagator copies the same error,
and whoever is right stays rejected: the rejection feeds itself. Nothing in (12)-(36) ends this.

What can end it is a witness that the reference had no part in. Two subsystems that measure the same states differ,
z_a - z_b, by their own errors only. When both have been rejected through a window, and agree with each other through
it, the reference is wrong and not they. They are `believed`, what they measure is made so uncertain in the filters
that their residuals are expected (`widen`), and both propagators start anew from the fused estimate
(`ftcore.detection.propagators.renew`).

Two faults that happen to meet agree as well, for as long as it takes one to pass the other (a sine of 8 m and 0.02
rad/s stays near a bias of 7.5 m for a minute and a half, longer than one would wait). But they *drift* into agreement,
while a fault that ends *jumps* into it. So a pair that has fallen out is estranged; it is heard again after a jump into
agreement, or when it has agreed for `PATIENCE` epochs on end. A pair that never fell out (both left behind by a poor
inertial model) is heard at once.

What this cannot do: a pair that comes together without a visible jump (less than about 1.5 sigma of the difference on
three axes) waits for `PATIENCE`, and a subsystem without a peer, as the star tracker, has no such witness. Its way back
is the process noise, which widens the reference while nobody corrects it.

Source: FTLab's own; the trap is implied by steps 3 and 4 of section 3.2 of C. Yang, A. Mohammadi and Q.-W. Chen,
Sensors 16 (2016). Tests on means of whitened differences are those of M. Basseville and I.V. Nikiforov, Detection of
Abrupt Changes (1993), chapter 2, with windows of fixed length.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ftcore.detection.chi_square import threshold
from ftcore.detection.result import Array, Ints, Mask
from ftcore.estimation import kalman
from ftcore.estimation.imm import Mixture
from ftcore.estimation.tolerant_fusion import Layout, noise

PATIENCE = 100
"""Epochs of agreement after which an estranged pair is heard although nobody saw it jump into agreement."""
P_AGREE = 1e-3
"""Tail probability of the tests for agreement over a window."""
P_JUMP = 1e-4
"""Tail probability of the tests for a jump, and for having fallen out, over half a window."""


@dataclass(frozen=True, slots=True)
class Standoff:
    """What is remembered of the pairs: values, one epoch's after the other's."""

    pairs: tuple[tuple[int, int], ...]
    differences: Array
    """Whitened z_a - z_b of the last `window` epochs, newest last, (runs, window, pairs, rows); NaN where one was
    missing: nothing is said of a window with a gap in it."""
    doubts: Array
    """1 - beta of the one of a pair that was believed more, (runs, window, pairs)."""
    estranged: Mask
    """Pairs that have fallen out, (runs, pairs)."""
    agreed: Ints
    """Epochs in a row that the pair has agreed, (runs, pairs)."""


def start_standoff(
    runs: int, layout: Layout, pairs: Sequence[tuple[int, int]] = ((0, 1),), window: int = 24
) -> Standoff:
    """Nothing seen yet. `pairs`: subsystems, by their places in the layout, that measure the same states with equal H.

    `window`: epochs of agreement, and of rejection, that it takes to believe a pair; even. Raises ValueError for a pair
    of unlike rows or of pairs with unlike rows, and for a window that is not even and positive.
    """
    rows = {layout.sizes[i] for pair in pairs for i in pair}
    if len(rows) != 1:
        raise ValueError(f"subsystems are compared row by row; the pairs {list(pairs)} have {sorted(rows)} rows")
    if window < 2 or window % 2:
        raise ValueError(f"the window is an even number of epochs, so that it has two halves; got {window}")
    count = len(pairs)
    return Standoff(
        tuple(pairs),
        np.full((runs, window, count, rows.pop()), np.nan),
        np.zeros((runs, window, count)),
        np.zeros((runs, count), dtype=bool),
        np.zeros((runs, count), dtype=np.int64),
    )


def stand_off(
    state: Standoff, y: Array, R: Array, beta: Array, layout: Layout, valid: Mask | None = None
) -> tuple[Standoff, Mask]:
    """One epoch on; returns which subsystems are to be believed against the reference, (runs, s).

    y (runs, m), R and `valid` as in `tolerant_fusion.subset_updates`; beta (runs, s): validities. A
    pair is heard when neither has been believed by half over the window; that is forgotten when it is heard, so that
    it is not heard again before another window.
    """
    window = state.differences.shape[1]
    half, rows = window // 2, state.differences.shape[-1]
    d = np.stack([_difference(y, R, layout, pair, valid) for pair in state.pairs], axis=1)
    doubt = np.stack([1.0 - np.maximum(beta[:, a], beta[:, b]) for a, b in state.pairs], axis=1)
    differences = np.concatenate([state.differences[:, 1:], d[:, None]], axis=1)
    doubts = np.concatenate([state.doubts[:, 1:], doubt[:, None]], axis=1)

    old, new = differences[:, :half].mean(axis=1), differences[:, half:].mean(axis=1)
    # NaN, where a reading is missing, makes every comparison False: neither agreement nor disagreement is claimed.
    through = 0.25 * window * np.square(old + new).sum(axis=-1) < threshold(P_AGREE, rows)
    through &= np.square(differences).sum(axis=(1, 3)) < threshold(P_AGREE, rows * window)
    lately = _lately(differences, half)
    jumped = 0.5 * half * np.square(new - old).sum(axis=-1) > threshold(P_JUMP, rows)
    jumped &= lately < threshold(P_AGREE, rows)
    agreed = np.where(through, state.agreed + 1, 0)
    missing = np.isnan(d).any(axis=-1)
    estranged = state.estranged | (lately > threshold(P_JUMP, rows))
    estranged &= ~(jumped | missing | (agreed >= PATIENCE))

    heard = through & ~estranged & (doubts.mean(axis=1) >= 0.5)
    believed = np.zeros(beta.shape, dtype=bool)
    for i, (a, b) in enumerate(state.pairs):
        believed[:, a] |= heard[:, i]
        believed[:, b] |= heard[:, i]
    doubts = np.where(heard[:, None], 0.0, doubts)
    return replace(state, differences=differences, doubts=doubts, estranged=estranged, agreed=agreed), believed


def fallen_out(state: Standoff, ago: int = 0) -> Mask:
    """Pairs that have disagreed over half a window, (runs, pairs), up to ``ago`` epochs before the last, at most half a
    window; not where a reading was missing."""
    window, rows = state.differences.shape[1], state.differences.shape[-1]
    return np.asarray(_lately(state.differences[:, : window - ago], window // 2) > threshold(P_JUMP, rows))


def _lately(differences: Array, half: int) -> Array:
    """The mean difference over the last `half` epochs, squared and whitened: chi-square on the rows of a pair."""
    return np.asarray(half * np.square(differences[:, -half:].mean(axis=1)).sum(axis=-1))


def widen(prior: Mixture, y: Array, H: Array, layout: Layout, believed: Mask) -> Mixture:
    """The prediction with what the believed subsystems (runs, s) measure made so uncertain that their word is expected.

    The residual r of a believed subsystem asks for A = H P H' to be k = max(1, r' A^-1 r / rows) times as large. Every
    state's standard deviation grows by 1 + (sqrt(k) - 1) rho, where rho is its multiple correlation with H x:
    by sqrt(k) what is measured, by less the velocity that belongs to it, and hardly a bias that has nothing to do with
    it. Correlations stay. (To multiply all of P by k sets the gyro biases loose, and the next bad reading of the star
    tracker turns them over; to widen H x alone, the others keeping their law given it, leaves velocities wrong.)
    Subsystems one after the other; runs in which nobody is believed are untouched. y (runs, m), H (runs, m, n): rows of
    believed subsystems are valid.
    """
    if not believed.any():
        return prior
    P = prior.P.copy()
    for i, rows in enumerate(layout.slices):
        asked = np.flatnonzero(believed[:, i])
        if not asked.size:
            continue
        H_i = np.broadcast_to(H, (len(P), *H.shape[1:]))[asked, None, rows]
        HP = H_i @ P[asked]
        whitener = kalman.triangular_inverse(kalman.cholesky(kalman.symmetric(HP @ H_i.swapaxes(-1, -2))))
        r = y[asked, None, rows] - np.matvec(H_i, prior.x[asked])
        k = np.maximum(1.0, np.square(np.matvec(whitener, r)).mean(axis=-1))
        variance = np.diagonal(P[asked], axis1=-2, axis2=-1)
        explained = np.square(whitener @ HP).sum(axis=-2) / np.where(variance > 0.0, variance, np.inf)
        growth = 1.0 + (np.sqrt(k)[..., None] - 1.0) * np.sqrt(np.minimum(explained, 1.0))
        P[asked] *= growth[..., :, None] * growth[..., None, :]
    return replace(prior, P=P)


def _difference(y: Array, R: Array, layout: Layout, pair: tuple[int, int], valid: Mask | None) -> Array:
    """z_a - z_b in units of its standard deviation, (runs, rows); NaN where a row of either is not valid."""
    a, b = (layout.slices[i] for i in pair)
    d = y[:, a] - y[:, b]
    if R.ndim == 3:
        full = noise(R, valid)
        d = np.matvec(kalman.triangular_inverse(kalman.cholesky(full[:, a, a] + full[:, b, b])), d)
    else:
        d = d / np.sqrt(R[..., a] + R[..., b])
    if valid is not None:
        d = np.where((valid[:, a] & valid[:, b]).all(axis=-1, keepdims=True), d, np.nan)
    return np.asarray(d)
