"""No rejection for ever, for a subsystem without a peer: it is believed again when it moves as the inertial unit says.

Two receivers can bear witness for each other (:mod:`ftcore.detection.recovery`); a star tracker has nobody but the
gyros. Its reference may be wrong without saying so: rates that no filter models (scale factors in a turn), or a bias
that was learned from a fault before that was noticed, carry it away faster than its covariance grows.

So the subsystem is laid against the *raw* inertial motion, free of whatever the filters have learned. What the unit's
data sheet allows (a bias, a scale factor on each axis) enters as a consider covariance: `reach`, the sensitivity of the
inertial error to those parameters, each in units of its standard deviation, so that the error made between two epochs
has the covariance G G', G the difference of the reaches. Nothing else is assumed, nothing is tuned to a filter. Of a
subsystem that is rejected it is asked

    steady     over `WINDOW` epochs it differs from the raw motion by a constant, by what the data sheet allows, and by
               its own white noise: noise, spikes, a stuck reading in a turn, or a fault that moves faster than gyros
               drift do not;
    in reach   it has gone no further from the raw motion than the data sheet allows, since a moment `STANDING` to
               twice as many epochs of trust ago: not since it was last trusted, for what looked like drift until then
               may have been a fault;
    not moved  it did not part by a jump. An inertial unit drifts, a sensor jumps: one jump out of good standing is a
               bias that has come and is still there, a second one may have ended it.

Then the reference is wrong, and the subsystem is believed, for `HEARING` epochs, in which the filters learn from it
what went wrong. A fault that stays in reach and moves as slowly as gyros drift cannot be told from their drift by
anybody who has just the two; it is believed too, and does no more harm than the drift would.

Source: FTLab's own. Parameters that are considered and not estimated: S.F. Schmidt (1966); as in B.D. Tapley, B.E.
Schutz and G.H. Born, Statistical Orbit Determination (2004), chapter 6. Steps of whitened differences: M. Basseville
and I.V. Nikiforov, Detection of Abrupt Changes (1993), chapter 2.
"""

from dataclasses import dataclass, replace

import numpy as np

from ftcore.detection.chi_square import threshold
from ftcore.detection.result import Array, Ints, Mask
from ftcore.estimation import kalman

Anchors = tuple[Array, Array, Array]

WINDOW = 20
"""Epochs of steadiness that it takes."""
MEMORY = 10
"""Epochs that say how it stands: rejected or trusted is who was so in `MOST` of them; between them it is doubted."""
MOST = 0.8
"""Share of epochs."""
STANDING = 150
"""Epochs of trust without a break that make good standing."""
HEARING = 10
"""Epochs for which it is then believed whatever its test says."""
P_STEADY, P_REACH, P_JUMP = 1e-3, 1e-3, 1e-5
"""Tail probabilities of the three questions, each for a sound subsystem and a unit as good as its data sheet."""
DRAGGED = 10.0
"""Standard deviations of a reading that do not count in the question of reach, for units without errors to speak of."""


@dataclass(frozen=True, slots=True)
class Coast:
    """What is remembered of the subsystem: values, one epoch's after the other's."""

    raw: Array
    """Raw inertial motion less the subsystem's reading in the last `WINDOW` epochs, newest last, (runs, window, rows);
    NaN where a reading was missing."""
    reach: Array
    """Sensitivity of the raw motion at those epochs, (runs, window, rows, k)."""
    trust: Array
    """Validities of the last `MEMORY` epochs, (runs, memory)."""
    anchor: Array
    """`raw` at two moments of trust, the older one first, (runs, 2, rows)."""
    anchor_reach: Array
    """`reach` then, (runs, 2, rows, k)."""
    learned: Array
    """What the filters had learned then, (runs, 2, l)."""
    anchored: Ints
    """Epochs of trust since the newer of them, (runs,)."""
    jumps: Ints
    """Jumps since it was last trusted, (runs,), those out of bad standing counted twice."""
    steady: Ints
    """Epochs since the last jump or gap, (runs,)."""
    trusted: Ints
    """Epochs of trust without a break, (runs,)."""
    hearing: Ints
    """Epochs for which it is still to be believed, (runs,)."""


def moved(state: Coast) -> Mask:
    """Where the subsystem has parted by a jump out of good standing and has not jumped since, (runs,); forgotten after
    `STANDING` epochs, lest the end of a fault that nobody noticed bars it for ever."""
    return np.asarray((state.jumps == 1) & (state.steady < STANDING))


def start(runs: int, rows: int, k: int, learned: int) -> Coast:
    """Nothing seen yet, in good standing. `k`: parameters of the data sheet; `learned`: of what the filters learn."""
    none = np.zeros(runs, dtype=np.int64)
    return Coast(
        raw=np.full((runs, WINDOW, rows), np.nan),
        reach=np.zeros((runs, WINDOW, rows, k)),
        trust=np.ones((runs, MEMORY)),
        anchor=np.full((runs, 2, rows), np.nan),
        anchor_reach=np.zeros((runs, 2, rows, k)),
        learned=np.zeros((runs, 2, learned)),
        anchored=none,
        jumps=none,
        steady=none,
        trusted=np.full(runs, STANDING),
        hearing=none,
    )


def coast(
    state: Coast, raw: Array, reach: Array, variance: float, beta: Array, learned: Array
) -> tuple[Coast, Mask, Mask]:
    """One epoch on; returns where the subsystem is to be believed against the reference, (runs,), and where just now
    it began to be.

    raw (runs, rows): what the raw inertial motion says, less the reading; NaN without a reading. reach (runs, rows, k):
    its sensitivity, both counted from any origin. variance: of a row's white noise. beta (runs,): validity by the
    test against the reference. learned (runs, l): what the filters have learned of the unit, to be looked up later.
    """
    seen = ~np.isnan(raw).any(axis=-1)
    jumped = _jumped(raw - state.raw[:, -1], reach, state.reach[:, -1], variance)

    trust = np.concatenate([state.trust[:, 1:], beta[:, None]], axis=1)
    rejected = np.equal(trust, 0.0).mean(axis=1) >= MOST
    blamed = np.where(state.trusted >= STANDING, 1, 2)
    jumps = np.where(jumped, state.jumps + blamed, state.jumps)
    steady = np.where(seen & ~jumped, state.steady + 1, 0)
    windows = np.concatenate([state.raw[:, 1:], raw[:, None]], axis=1)
    reaches = np.concatenate([state.reach[:, 1:], reach[:, None]], axis=1)

    asked = np.asarray(rejected & (steady >= WINDOW) & (jumps != 1) & (state.hearing == 0))
    heard = np.zeros(len(raw), dtype=bool)
    if asked.any():
        heard[asked] = _moves_alike(windows[asked], reaches[asked], variance) & _in_reach(
            windows[asked], reach[asked], state.anchor[asked, 0], state.anchor_reach[asked, 0], variance
        )
    hearing = np.where(heard, HEARING, np.where(jumped, 0, state.hearing))
    believed = (hearing > 0) & seen

    # Who is heard has to earn trust anew; the jump of a sound one that is rejected just now is remembered.
    trusted = np.where(rejected | believed, 0, state.trusted + 1)
    forgotten = ~jumped & (beta >= 1.0) & (trust.mean(axis=1) >= MOST)
    anchored = state.anchored + forgotten
    first = np.asarray(np.isnan(state.anchor).any(axis=(-1, -2)) & seen)
    drop = np.asarray((anchored >= STANDING) & forgotten & seen | first)
    anchors = state.anchor, state.anchor_reach, state.learned
    if drop.any():
        anchors = _dropped(anchors, (raw, reach, learned), drop, first)
    after = replace(
        state,
        raw=windows,
        reach=reaches,
        trust=trust,
        anchor=anchors[0],
        anchor_reach=anchors[1],
        learned=anchors[2],
        anchored=np.where(drop, 0, anchored),
        jumps=np.where(forgotten | heard, 0, jumps),
        steady=steady,
        trusted=trusted,
        hearing=np.maximum(hearing - 1, 0),
    )
    return after, np.asarray(believed), heard


def _dropped(anchors: Anchors, now: Anchors, where: Mask, first: Mask) -> Anchors:
    """The newer anchor becomes the older one, and `now` the newer; both are `now` the first time."""

    def dropped(old: Array, new: Array) -> Array:
        shape = (-1, *(1,) * (new.ndim - 1))
        moved = np.stack([np.where(first.reshape(shape), new, old[:, 1]), new], axis=1)
        return np.where(where.reshape(*shape, 1), moved, old)

    anchor, reach, learned = (dropped(old, new) for old, new in zip(anchors, now, strict=True))
    return anchor, reach, learned


def _jumped(step: Array, reach: Array, before: Array, variance: float) -> Mask:
    """Whether a step (runs, rows) is more than white noise and what the data sheet allows in an epoch, (runs,). NaN,
    where a reading is missing, makes the comparisons False: no jump is claimed."""
    limit = threshold(P_JUMP, step.shape[-1])
    jumped = np.asarray(np.square(step).sum(axis=-1) > 2.0 * variance * limit)
    if jumped.any():  # hardly ever: without its data sheet a step looks larger than it is
        G = (reach - before)[jumped]
        spread = 2.0 * variance * np.eye(step.shape[-1]) + G @ G.swapaxes(-1, -2)
        jumped[jumped] = _norm(step[jumped], spread) > limit
    return jumped


def _moves_alike(raw: Array, reach: Array, variance: float) -> Mask:
    """Whether a window (runs, window, rows) is a constant, what the data sheet allows, and white noise, (runs,)."""
    runs, window, rows = raw.shape
    r = (raw - raw.mean(axis=1, keepdims=True)).reshape(runs, -1)
    G = (reach - reach.mean(axis=1, keepdims=True)).reshape(runs, window * rows, -1)
    # r' (R + G G')^-1 r by the inversion lemma: k is much smaller than the window.
    g = np.vecmat(r, G)
    L_inv = kalman.triangular_inverse(kalman.cholesky(variance * np.eye(G.shape[-1]) + G.swapaxes(-1, -2) @ G))
    q = (np.square(r).sum(axis=-1) - np.square(np.matvec(L_inv, g)).sum(axis=-1)) / variance
    return np.asarray(q < threshold(P_STEADY, rows * (window - 1)))


def _in_reach(raw: Array, reach: Array, anchor: Array, anchor_reach: Array, variance: float) -> Mask:
    """Whether the latest of a window lies where raw motion from the anchor may have led, (runs,)."""
    rows = raw.shape[-1]
    G = reach - anchor_reach
    spread = (1.0 + DRAGGED**2) * variance * np.eye(rows) + G @ G.swapaxes(-1, -2)
    return np.asarray(_norm(raw[:, -1] - anchor, spread) < threshold(P_REACH, rows))


def _norm(d: Array, covariance: Array) -> Array:
    """d' C^-1 d, (runs,)."""
    return np.asarray(np.square(np.matvec(kalman.triangular_inverse(kalman.cholesky(covariance)), d)).sum(axis=-1))
