"""When aids that agree with each other overrule the inertial solution that they all contradict.

Parity may be deceived: two instruments that fail at once can look like the failure of a third, which is put out, and
the two that are wrong agree. Their solution runs away with a covariance that knows nothing of it; the aids contradict
it, are put out for that, and stay out for good, because they are judged by it.

Who is right is a matter of votes. The aids are laid against the inertial solution with its position, velocity and
attitude opened wide (`smallest_opening`): what is left is how they agree with each other. If aids are out that agree
with each other for `PATIENCE` epochs without a break, they are right and the inertial solution is wrong, provided that

    it is doubted        its instruments contradicted each other, or one of them was out, at most `MEMORY` epochs before
                         the first aid was put out; the doubt does not end while one is out; or
    nobody supports it   two aids or more are there, and all of them are out.

So a single faulty aid never gets a vote by itself, however well it agrees with itself: an inertial unit that nobody
doubts and the other aids are against it.

Then the covariance of the inertial solution is opened as far as the contradiction goes, and the aids are taken back.

Source: FTLab's own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ftcore.detection import chi_square
from ftcore.detection.result import Array, Ints, Mask
from ftcore.estimation import kalman

PATIENCE = 15
"""Epochs for which aids that are out have to agree with each other."""
MEMORY = 60
"""Epochs for which an inertial unit is doubted after its last contradiction."""
P_SOUND = 1e-3
"""Tail probability of what sound aids say of each other in an epoch."""
DOUBLINGS = 7
"""Openings that are tried: 1, 2, 4, ... times the basic one."""
MARGIN = 2.0
"""By how much more is opened than the smallest opening that agrees."""


@dataclass(frozen=True, slots=True)
class State:
    """What is carried from epoch to epoch, ``(runs,)`` each.

    Attributes:
        doubt: epochs for which the inertial unit is still doubted.
        agreed: epochs in a row in which aids that are out agreed with each other.
    """

    doubt: Ints
    agreed: Ints


def start(runs: int) -> State:
    """Nobody doubted."""
    nothing = np.zeros(runs, np.int64)
    return State(nothing, nothing)


def asked(state: State, out: Mask, there: Mask) -> Mask:
    """Where the aids have a vote, ``(runs,)``: ``there (runs, aids)`` with a reading, ``out (runs, aids)`` isolated."""
    out = out & there
    unsupported = (there.sum(axis=-1) > 1) & (out | ~there).all(axis=-1)
    return np.asarray(out.any(axis=-1) & (state.doubt > 0) | unsupported)


def step(state: State, contradictory: Mask, out: Mask, agree: Mask) -> tuple[State, Mask]:
    """One epoch on; returns where the inertial solution is overruled, ``(runs,)``.

    ``contradictory (runs,)``: the instruments contradict each other, or one is out; ``out (runs, aids)``: isolated;
    ``agree (runs,)``: those aids that are there agree with each other, and were asked (see `asked`).
    """
    agreed = np.where(agree, state.agreed + 1, 0)
    due = agreed >= PATIENCE
    doubt = np.where(out.any(axis=-1), state.doubt, np.maximum(state.doubt - 1, 0))
    doubt = np.where(contradictory | due, MEMORY, doubt)
    return State(doubt, np.where(due, 0, agreed)), np.asarray(due)


def smallest_opening(
    x: Array, P: Array, y: Array, H: Array, R: Array, valid: Mask, basic: Array, determined: Ints
) -> Array:
    """The factor of the opening with which all measurements agree, ``(runs,)``; infinite where none does.

    x ``(runs, n)``, P ``(runs, n, n)``, y ``(runs, m)``, H ``(runs, m, n)``, R ``(runs or 1, m)``, valid ``(runs, m)``.
    ``basic (n,)``: standard deviations that a factor of 1 opens; ``determined (runs,)``: how many combinations of the
    opened states the measurements determine. Those take their degrees of freedom; where none is left nothing agrees.
    """
    factor = np.full(len(x), np.inf)
    for doubling in reversed(range(DOUBLINGS)):
        opened = P + np.diag(np.square(2.0**doubling * basic))
        found = kalman.innovation(x, opened, y, H, R, valid)
        dof = np.maximum(found.dof - determined, 0)
        limit = chi_square.threshold(P_SOUND, dof)
        agrees = (found.statistic <= limit) & (dof > 0)
        if not agrees.any():
            break
        factor = np.where(agrees, 2.0**doubling, factor)
    return factor
