"""What a healthy cluster's biases and scale factors make of the parity vector, learned while it flies.

Axis i of a moving cluster reads h_i x (1 + s_i) + b_i + noise, so the parity vector p = V m has the mean

    V b + V diag(H x) s,

linear in the constants b and s, with the rate or specific force x of the moment as coefficient. A Kalman filter on
V b and s learns them from the parity vectors of a healthy cluster. Its prediction is the mean that p is tested about,
and its innovation covariance is what p is tested with: what is not known yet about s counts by the momentary x, what is
known does not count. Innovations are white, so the test is exact and alarms are independent.

A fault must not be learned. Nothing is taken in that is beyond `P_GROSS`, nor while an instrument is out or silent; and
when one is found faulty, the filter goes back to what it knew `KEPT` to twice as many epochs before, by which time a
fault that grew slowly had grown less. (To learn nothing from an alarm at P_fa would turn one into many: a scale factor
in the tail of its law alarms when it is first excited, and would go on to until the turn is over.) Biases and scale
factors may wander a little (`WANDER`): what was learned wrongly is forgotten within minutes.

Everything is in units of the white noise of one reading, rows (n,) of clusters lead: one row for each run and cluster.
Source: S.R. Hall, P. Motyka, E. Gai and J.J. Deyst, In-flight parity vector compensation for FDI, IEEE Trans. AES 19
(1983), for the filter; the gate and the way back are FTLab's.
"""

from dataclasses import dataclass, replace

import numpy as np

from ftcore.detection import chi_square, parity_space
from ftcore.detection.geometry import Cluster
from ftcore.detection.parity_space import Reference
from ftcore.detection.result import Array, Mask
from ftcore.estimation import kalman

KEPT = 10
"""Epochs between the states that are kept to go back to."""
WANDER, WANDER_OF_SCALE = 0.005, 0.001
"""Random walk an epoch: of V b in units of the white noise, of s in units of its 1-sigma."""
P_GROSS = 1e-6
"""Parity vectors that a healthy cluster exceeds with this probability teach nothing."""
_FARTHEST = 1e6
"""A scale factor moves a reading by no more than so many sigmas of noise: beyond, nothing is left to be said of p."""


@dataclass(frozen=True, slots=True)
class Knowledge:
    """V b and s: mean (n, r + axes) and covariance (n, r + axes, r + axes)."""

    x: Array
    P: Array


@dataclass(frozen=True, slots=True)
class State:
    """What is known now, and what was known at two earlier moments, for each row."""

    now: Knowledge
    newer: Knowledge
    older: Knowledge
    since: int
    """Epochs since the newer one was kept."""


@dataclass(frozen=True, slots=True)
class Expected:
    """What a healthy cluster shows at this moment."""

    mean: Array
    """Of p, (n, r)."""
    spread: Array
    """Covariance of p without the noise of the reading, (n, r, r)."""
    H: Array
    """How p answers to V b and s, (n, r, r + axes)."""


def start(cluster: Cluster, at_rest: Array, x: Array, bias: Array, noise: float, scale: Array) -> State:
    """What is known after a calibration at rest.

    Args:
        cluster: geometry.
        at_rest: (n, axes) mean readings.
        x: (n, 3) what was measured at rest.
        bias: (n,) 1-sigma of an axis' bias.
        noise: standard deviation of `at_rest`.
        scale: (n,) 1-sigma of an axis' scale factor.
    """
    r, axes = cluster.V.shape
    variance = np.concatenate([np.repeat(np.square(bias)[:, None], r, axis=1), np.ones((len(x), axes))], axis=1)
    prior = Knowledge(np.zeros((len(x), r + axes)), variance[:, :, None] * np.eye(r + axes))
    H = _answers(cluster, x, scale)
    p = np.matvec(cluster.V, at_rest)
    done = kalman.update(prior.x, prior.P, p, H, np.full((1, r), noise**2), joseph=True)
    known = Knowledge(done.x, done.P)
    return State(known, known, known, 0)


def expected(state: State, cluster: Cluster, x: Array, scale: Array) -> Expected:
    """Mean and spread of a healthy p at the momentary rate or specific force `x` (n, 3)."""
    H = _answers(cluster, x, scale)
    spread = H @ state.now.P @ H.swapaxes(-1, -2)
    return Expected(np.matvec(H, state.now.x), kalman.symmetric(spread), H)


def reference(of: Reference, expected: Expected) -> Reference:
    """The cluster's parity space with what is expected of it at this moment; readings have unit noise."""
    return parity_space.momentary(of, expected.mean, expected.spread + np.eye(expected.mean.shape[-1]))


def learn(state: State, expected: Expected, p: Array, healthy: Mask, guilty: Mask) -> State:
    """One epoch on.

    `p` (n, r): V m, nothing taken off; `healthy` (n,): rows in which nothing else is wrong; `guilty` (n,): rows in
    which a faulty instrument was found just now, which go back to what they knew before.
    """
    now, r = state.now, p.shape[-1]
    off = p - expected.mean
    S = expected.spread + np.eye(r)
    healthy = healthy & (np.vecdot(off, np.linalg.solve(S, off[..., None])[..., 0]) < chi_square.threshold(P_GROSS, r))
    if healthy.any():
        wander = np.full(now.P.shape[-1], WANDER_OF_SCALE**2)
        wander[:r] = WANDER**2
        P = now.P + np.diag(wander)
        done = kalman.update(now.x, P, p, expected.H, np.ones((1, r)), joseph=True)
        now = _where(healthy, Knowledge(done.x, done.P), now)
    if guilty.any():
        now = _where(guilty, state.older, now)
        state = replace(state, newer=_where(guilty, state.older, state.newer))
    if state.since + 1 < KEPT:
        return replace(state, now=now, since=state.since + 1)
    # Where p is gross nothing is kept: who is found guilty later goes back to before it.
    newer, older = _where(healthy, now, state.newer), _where(healthy, state.newer, state.older)
    return State(now, newer, older, 0)


def _answers(cluster: Cluster, x: Array, scale: Array) -> Array:
    """How p answers to V b and s, s in units of its 1-sigma: (n, r, r + axes)."""
    felt = np.clip(np.matvec(cluster.H, x) * scale[:, None], -_FARTHEST, _FARTHEST)
    r = cluster.V.shape[0]
    return np.concatenate([np.broadcast_to(np.eye(r), (len(x), r, r)), cluster.V * felt[:, None]], axis=-1)


def _where(rows: Mask, new: Knowledge, old: Knowledge) -> Knowledge:
    return Knowledge(np.where(rows[:, None], new.x, old.x), np.where(rows[:, None, None], new.P, old.P))
