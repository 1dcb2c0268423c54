"""The generalised likelihood ratio test for a step of unknown size, unknown onset and unknown place.

Hypothesis (theta, c): from epoch theta on, column c of the measurement reads b too much, or, for a state jump, the
truth jumped by b along a direction f at theta. A filter that goes on unaware has an innovation of mean G b, where

    F_k = Phi F_{k-1} + K_k G_k,    G_k = e_c - H_k Phi F_{k-1},    F_{theta-1} = 0            (a step of column c)
    the same with G_k = -H_k Phi F_{k-1} and Phi F_{theta-1} = -f                              (a jump along f)

F b being the mean of the estimate's error. Innovations are white, so the evidence simply adds up,

    d = sum_k G_k' S_k^-1 nu_k,    C = sum_k G_k' S_k^-1 G_k,

and with the most likely size b = d / C, twice the logarithm of the likelihood ratio is d^2 / C. The test takes the
largest over the onsets of a window and over all columns. Each d^2 / C is chi-square on one degree of freedom without a
fault; their largest exceeds the threshold of

    1 - (1 - p_fa)^(1 / hypotheses)

with probability `p_fa` at most, in any one epoch, whatever the correlation of the hypotheses (Sidak's inequality).
Neighbouring onsets are alike, the more so the longer the filter takes to swallow a step, and the actual rate is lower:
0.4 to 0.8 of p_fa for a GPS-like filter, 0.3 at the least (no filter at all, window of 30), all of it at the most (a
filter that forgets at once). Measured in tests/core/test_likelihood_ratio.py.

It wants the innovations of a filter that takes every measurement in, faulty or not. An epoch whose measurement was
withheld has to be passed as not valid, gives no evidence, and leaves the statistic as it was. When the filter is reset,
so must this be (`reset`).

Columns are named by integer ids, so that they may come and go (satellites rise and set): a column that appears has no
past, one that disappears is forgotten. Shapes lead with runs; what is common to all runs may lead with 1.
Source: A.S. Willsky and H.L. Jones, A generalized likelihood ratio approach to the detection and estimation of jumps in
linear systems, IEEE Trans. AC 21 (1976); Z. Sidak, J. Amer. Stat. Assoc. 62 (1967).
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.stats import chi2

from ftcore.detection.result import Array, Ints, Mask, TestResult
from ftcore.estimation.kalman import Update

_TABLE_SIZE = 4096
BLOCK = 8
"""Runs whose signatures are worked on together."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What the test remembers. Onsets live in a ring: epoch k, counted from 0, uses place k modulo the window."""

    epoch: int
    """Epochs seen."""
    ids: Ints
    """Ids of the measurement columns, (m,). Behind them, in `F`, `d` and `C`, come the state jumps."""
    directions: Array
    """Directions of state jumps, (n, jumps)."""
    F: Array
    """Effect of a step of 1 on the estimate, (runs, n, window, columns)."""
    d: Array
    """Correlation of the signatures with the innovations, (runs, window, columns)."""
    C: Array
    """Information about the size, (runs, window, columns)."""

    @property
    def window(self) -> int:
        """How many onsets are considered."""
        return int(self.F.shape[2])


def start(states: int, window: int, directions: Array | None = None) -> State:
    """Nothing seen yet, by a filter of `states` states; onsets of the last `window` epochs will be considered.

    `directions` (states, jumps): state jumps to consider besides steps of the measurement columns. Raises ValueError
    for an empty window or directions of another number of states.
    """
    if window < 1:
        raise ValueError(f"the window of onsets is at least one epoch, not {window}")
    if directions is None:
        directions = np.zeros((states, 0))
    if directions.ndim != 2 or directions.shape[0] != states:
        raise ValueError(f"directions of state jumps are ({states}, jumps); got shape {directions.shape}")
    jumps = directions.shape[1]
    F, nothing = np.zeros((1, states, window, jumps)), np.zeros((1, window, jumps))
    return State(0, np.zeros(0, dtype=np.int64), directions, F, nothing, nothing)


def step(state: State, update: Update, Phi: Array, H: Array, ids: Ints, valid: Mask | None = None) -> State:
    """Take the innovation of one epoch into account.

    `update` (runs,): of the filter that is watched; Phi (runs, n, n): the transition that led to it; H (runs, m, n): of
    its measurement; ids (m,): a name for each column, all different, the same column by the same name in every epoch;
    valid (runs, m), as it was given to the update.
    """
    if ids is not state.ids and not np.array_equal(ids, state.ids):
        state = _realigned(state, ids)
    runs = len(update.reach)  # 1 where the covariances are common to all runs: then so are the signatures
    if runs <= BLOCK:
        return _step(state, update.whitener, update.whitened, update.reach, Phi, H, ids, valid)
    parts = []
    for start in range(0, runs, BLOCK):

        def here(array: Array, start: int = start) -> Array:
            return array if len(array) == 1 else array[start : start + BLOCK]

        parts.append(
            _step(
                replace(state, F=here(state.F), d=here(state.d), C=here(state.C)),
                here(update.whitener),
                here(update.whitened),
                here(update.reach),
                here(Phi),
                here(H),
                ids,
                valid if valid is None or len(valid) == 1 else valid[start : start + BLOCK],
            )
        )
    F, d, C = (np.concatenate([getattr(part, name) for part in parts]) for name in ("F", "d", "C"))
    return replace(parts[0], F=F, d=d, C=C)


def _step(
    state: State,
    whitener: Array,
    whitened_innovation: Array,
    reach: Array,
    Phi: Array,
    H: Array,
    ids: Ints,
    valid: Mask | None,
) -> State:
    """`step` for so few runs that their signatures stay in a core's cache."""
    n, W = state.F.shape[1:3]
    m, columns = len(ids), state.F.shape[3]
    place = state.epoch % W

    F = Phi @ state.F.reshape(-1, n, W * columns)
    onset = F.reshape(-1, n, W, columns)[:, :, place]
    onset[:, :, :m] = 0.0
    onset[:, :, m:] = -state.directions
    G = -(H @ F)
    rows = np.arange(m)
    G.reshape(-1, m, W, columns)[:, rows, :, rows] += 1.0
    if valid is not None and not valid.all():
        G = np.where(valid[:, :, None], G, 0.0)
    whitened = whitener @ G
    d = np.vecmat(whitened_innovation, whitened).reshape(-1, W, columns)
    C = np.square(whitened).sum(axis=1).reshape(-1, W, columns)
    F += reach.swapaxes(-1, -2) @ whitened  # K G, as K = W' L^-1
    before = np.arange(W)[:, None] != place
    return State(
        state.epoch + 1,
        ids,
        state.directions,
        F.reshape(-1, n, W, columns),
        state.d * before + d,
        state.C * before + C,
    )


def glr_test(state: State, p_fa: float, subject: str, name: str = "glr") -> TestResult:
    """Test for a step anywhere in the window: the largest d^2 / C against Sidak's threshold for so many hypotheses.

    `dof` is 1, or 0 (and no alarm) in a run without evidence. `extra`, each (runs,): `column`, the id of the culprit,
    or -1, -2, ... for the first, second, ... state jump; `age`, epochs since the onset, 0 for the latest epoch; `size`,
    the most likely step in the column's unit, or jump in units of its direction; `sigma`, the standard deviation of
    that. And `by_column` (runs, columns): the largest of every column.
    """
    runs, W, columns = state.d.shape
    known = state.C > 0.0
    ratio = np.where(known, np.square(state.d) / np.where(known, state.C, 1.0), 0.0)
    by_column = ratio.max(axis=1, initial=0.0)
    hypotheses = np.count_nonzero(known.any(axis=1), axis=-1) * min(state.epoch, W)
    limit = sidak_threshold(p_fa, hypotheses)
    dof = np.broadcast_to((hypotheses > 0).astype(np.int64), (runs,))
    limit = np.broadcast_to(limit, (runs,))
    if columns == 0:
        nobody = np.zeros(runs)
        return TestResult(name, subject, nobody, dof, limit, nobody > 0.0, extra={"by_column": by_column})
    culprit = by_column.argmax(axis=1)
    statistic = np.take_along_axis(by_column, culprit[:, None], axis=1)[:, 0]
    run, run_C = np.arange(runs), np.arange(len(state.C)) if len(state.C) == runs else np.zeros(runs, dtype=np.int64)
    place = ratio[run, :, culprit].argmax(axis=1)
    C = state.C[run_C, place, culprit]
    C = np.where(C > 0.0, C, np.inf)
    names = np.concatenate([state.ids, -1 - np.arange(columns - len(state.ids))])
    extra = {
        "column": names[culprit],
        "age": np.minimum((state.epoch - 1 - place) % W, state.epoch - 1),
        "size": state.d[run, place, culprit] / C,
        "sigma": 1.0 / np.sqrt(C),
        "by_column": by_column,
    }
    return TestResult(name, subject, statistic, dof, limit, (statistic >= limit) & (dof > 0), extra=extra)


def by_column(state: State) -> tuple[Array, Ints]:
    """The largest d^2 / C of every column over the onsets, and epochs since its onset, 0 for the latest epoch; both
    (runs, columns), columns in the order of `State.ids`. Without evidence the ratio is 0."""
    known = state.C > 0.0
    ratio = np.where(known, np.square(state.d) / np.where(known, state.C, 1.0), 0.0)
    place = ratio.argmax(axis=1)
    found = np.take_along_axis(ratio, place[:, None], axis=1)[:, 0]
    return found, np.minimum((state.epoch - 1 - place) % state.window, state.epoch - 1)


def reset(state: State, where: Mask) -> State:
    """Forget all evidence in the runs `where` (runs,): for a filter that was re-initialised, or a fault dealt with."""
    keep = ~where[:, None, None]
    return replace(state, F=state.F * keep[..., None], d=state.d * keep, C=state.C * keep)


def sidak_threshold(p_fa: float, hypotheses: Ints) -> Array:
    """What the largest of so many chi-square variables on 1 dof exceeds with probability `p_fa` at most.

    Exactly p_fa when they are independent, less when they are not. Infinite for none. Raises ValueError for a p_fa
    outside (0, 1).
    """
    table = _thresholds(p_fa)
    try:
        return np.asarray(table[hypotheses])
    except IndexError:
        return _sidak(p_fa, np.asarray(hypotheses))


@lru_cache(maxsize=64)
def _thresholds(p_fa: float) -> Array:
    if not 0.0 < p_fa < 1.0:
        raise ValueError(f"the false-alarm probability must lie between 0 and 1, not {p_fa}")
    table = _sidak(p_fa, np.arange(_TABLE_SIZE))
    table.flags.writeable = False
    return table


def _sidak(p_fa: float, hypotheses: Ints) -> Array:
    each = -np.expm1(np.log1p(-p_fa) / np.maximum(hypotheses, 1))
    return np.where(hypotheses > 0, chi2.isf(each, 1), np.inf)


def _realigned(state: State, ids: Ints) -> State:
    """The state for another set of columns: known ones keep their evidence, new ones begin without any."""
    if np.unique(ids).size != ids.size:
        raise ValueError(f"every measurement column needs an id of its own; got {ids.tolist()}")
    if (ids < 0).any():
        raise ValueError(
            f"ids of measurement columns are 0 or more, negative ones name state jumps; got {ids.tolist()}"
        )
    order = np.argsort(state.ids)
    at = np.searchsorted(state.ids, ids, sorter=order)
    source = order[np.minimum(at, len(order) - 1)] if len(order) else np.zeros(len(ids), dtype=np.int64)
    known = state.ids[source] == ids if len(order) else np.zeros(len(ids), dtype=bool)
    m = len(state.ids)

    def take(a: Array) -> Array:
        columns = a[..., source] * known if len(order) else np.zeros((*a.shape[:-1], len(ids)))
        return np.concatenate([columns, a[..., m:]], axis=-1)

    return replace(state, ids=ids, F=take(state.F), d=take(state.d), C=take(state.C))
