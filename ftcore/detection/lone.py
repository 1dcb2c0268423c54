"""No rejection for ever, for a subsystem without a peer.

Two receivers can bear witness for each other (:mod:`ftcore.detection.recovery`); a star tracker has nobody. But how it
parted from the reference says who is wrong. An inertial reference *drifts*, a sensor *jumps*: the step of its residual
from one epoch to the next, less its slope, is its own white noise, R + R, unless it fails or recovers just then. So, of
the jumps since the last time it was believed,

    none    the reference has drifted away,
    one     a bias has come and is still there,
    more    it was noise or a bias that ended, and is over once nothing jumps any more.

Rejected and without a jump for `STEADY` epochs, the subsystem is believed again, unless it has jumped just once; then
it takes `PATIENCE` epochs. A fault that drifts as slowly as the reference cannot be told from it, and is believed too.

Source: FTLab's own; steps of whitened residuals as in M. Basseville and I.V. Nikiforov, Detection of Abrupt Changes
(1993), chapter 2.
"""

from dataclasses import dataclass

import numpy as np

from ftcore.detection.chi_square import threshold
from ftcore.detection.result import Array, Ints, Mask

STEADY, PATIENCE = 30, 150
"""Epochs without a jump, while rejected, until it is believed; the latter where it has jumped just once."""
P_JUMP = 1e-5
"""Tail probability of a jump."""
SMOOTHING = 0.15
"""Weight of the newest change in the slope."""


@dataclass(frozen=True, slots=True)
class Lone:
    """What is remembered of a subsystem without a peer."""

    before: Array
    """Its residual of the epoch before, (runs, rows); NaN where there is none to compare with."""
    slope: Array
    """How much the residual changes in an epoch, smoothed, (runs, rows)."""
    jumps: Ints
    """Jumps since it was last believed, (runs,)."""
    steady: Ints
    """Epochs in a row that it has been rejected without a jump, (runs,)."""


def start(runs: int, rows: int) -> Lone:
    """Nothing seen yet."""
    return Lone(
        np.full((runs, rows), np.nan), np.zeros((runs, rows)), np.zeros(runs, np.int64), np.zeros(runs, np.int64)
    )


def step(state: Lone, y: Array, R: Array, beta: Array, present: Mask) -> tuple[Lone, Mask]:
    """One epoch on; returns whether it is to be believed against the reference, (runs,).

    y (runs, rows) SINS - sensor, R (rows,) its variances, beta (runs,) its validity, present (runs,) whether every row
    has a reading.
    """
    change = y - state.before
    d = (change - state.slope) / np.sqrt(2.0 * R)
    # NaN, where a reading is missing, makes the comparison False: no jump is claimed.
    jumped = np.square(d).sum(axis=-1) > threshold(P_JUMP, y.shape[-1])
    rejected = present & (beta < 0.5)
    jumps = np.where(jumped, state.jumps + 1, np.where(beta >= 1.0, 0, state.jumps))
    # A single second of agreement by chance does not end a rejection, it only does not lengthen it.
    steady = np.where(jumped, 0, np.where(rejected, state.steady + 1, np.where(beta >= 1.0, 0, state.steady)))
    believed = rejected & (steady >= np.where(jumps == 1, PATIENCE, STEADY))
    before = np.where(present[:, None], y, np.nan)
    slope = np.where(np.isnan(change), state.slope, state.slope + SMOOTHING * (change - state.slope))
    return Lone(before, slope, np.where(believed, 0, jumps), np.where(believed, 0, steady)), np.asarray(believed)


def moved(state: Lone) -> Lone:
    """The SINS was corrected: the next residual is not to be compared with the last."""
    return Lone(np.full_like(state.before, np.nan), state.slope, state.jumps, state.steady)
