"""A position from nothing but pseudoranges, whichever one of them, or two, are wrong by whatever amount.

A search from the Earth's centre with all satellites ends anywhere if one range is wrong by a millisecond of light. So
where the satellites do not agree, all sets without one of them are tried, then all without two: the set that agrees
best is the right one, as long as one satellite more than the unknowns is left in it to check the rest. Shapes lead with
``(runs,)``; all sets of all runs are solved side by side. Source: leave-one-out as in R.G. Brown, Navigation 39 (1992),
on the whole search instead of on its last step (FTLab).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.estimation.least_squares import UNKNOWNS, geometry, solve

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

AGREE: Final = 500.0
"""Largest residual of satellites that agree [m]: what the atmosphere leaves at the horizon, with a wide margin."""
_NEAREST, _FARTHEST = 6.3e6, 6.5e6
"""Distance from the Earth's centre that a cold start may end at [m]; a gross fault ends elsewhere."""
_WRONG: Final = 2
"""How many satellites may be wrong."""
_TOGETHER: Final = 5000
"""Sets that are solved at a time, so that memory stays bounded."""


@dataclass(frozen=True)
class Start:
    """What a search from nothing came to.

    Attributes:
        position: (runs, 3) Earth-fixed [m].
        found: (runs,) whether it is one: enough satellites, and an answer near the ground.
        worst: (runs,) largest residual of the satellites taken in [m].
        checked: (runs,) whether more satellites than unknowns are in it and all of them agree.
    """

    position: Array
    found: Mask
    worst: Array
    checked: Mask


def cold_start(pseudorange: Array, satellites_e: Array, valid: Mask, iterations: int = 9) -> Start:
    """Gauss-Newton from the centre of the Earth, all satellites with equal weight.

    Args:
        pseudorange: (runs, n), satellite clocks taken out [m].
        satellites_e: (n, 3) [m].
        valid: (runs, n).
    """
    runs = len(pseudorange)
    position, frame = np.zeros((runs, 3)), np.broadcast_to(np.eye(3), (runs, 3, 3))
    fix = None
    for _ in range(iterations):
        seen = geometry(position, frame, satellites_e)
        fix = solve(seen.H, pseudorange - seen.range, np.ones(1), valid)
        # A gross fault would send the search to where squares overflow; nobody on Earth is that far.
        step = np.clip(np.where(fix.solved[:, None], fix.x[:, :3], 0.0), -1e8, 1e8)
        position = np.clip(position + step, -1e8, 1e8)
    assert fix is not None
    radius = np.sqrt(np.vecdot(position, position))
    near = np.abs(fix.x[:, :3]).max(axis=-1) < 1.0
    found = np.asarray(fix.solved & near & (radius > _NEAREST) & (radius < _FARTHEST))
    worst = np.abs(fix.residual).max(axis=-1)
    return Start(position, found, worst, found & (fix.dof > 0) & (worst < AGREE))


def first_fix(pseudorange: Array, satellites_e: Array, valid: Mask) -> Start:
    """A cold start that survives one or two satellites that are wrong by any amount, where the others can tell.

    Arguments as of :func:`cold_start`. Where no set of satellites agrees, the answer is that of all satellites,
    which is then not ``checked``.
    """
    start = cold_start(pseudorange, satellites_e, valid)
    for missing in range(1, _WRONG + 1):
        open_ = np.flatnonzero(~start.checked & (valid.sum(axis=-1) - missing > UNKNOWNS))
        if not len(open_):
            break
        without = _left_out(valid.shape[-1], missing)
        each = max(_TOGETHER // len(without), 1)
        for first in range(0, len(open_), each):
            rows = open_[first : first + each]
            start = _better(start, rows, pseudorange, satellites_e, valid, without)
    return start


def _better(
    start: Start, rows: NDArray[np.intp], pseudorange: Array, satellites: Array, valid: Mask, without: Mask
) -> Start:
    """The start with the best of the sets ``without (sets, n)`` in ``rows``, where that one agrees."""
    sets, n = without.shape
    chosen = (valid[rows][:, None] & ~without).reshape(-1, n)
    tried = cold_start(np.repeat(pseudorange[rows], sets, axis=0), satellites, chosen)
    # Leaving out who is not there is no set of its own.
    own = (valid[rows][:, None] | ~without).all(axis=-1)
    worst = np.where(tried.checked.reshape(-1, sets) & own, tried.worst.reshape(-1, sets), np.inf)
    best = worst.argmin(axis=-1)
    agrees = np.isfinite(worst.min(axis=-1))
    index = (np.arange(len(rows)) * sets + best)[agrees]
    rows = rows[agrees]
    position, found, residual, checked = (
        start.position.copy(),
        start.found.copy(),
        start.worst.copy(),
        start.checked.copy(),
    )
    position[rows], found[rows], residual[rows], checked[rows] = tried.position[index], True, tried.worst[index], True
    return Start(position, found, residual, checked)


@lru_cache(maxsize=64)
def _left_out(n: int, missing: int) -> Mask:
    """All ways to leave ``missing`` of ``n`` satellites out, (ways, n)."""
    ways = (
        np.zeros((0, n), bool)
        if missing > n
        else np.array([[i in way for i in range(n)] for way in combinations(range(n), missing)], dtype=bool)
    )
    ways.setflags(write=False)
    return ways
