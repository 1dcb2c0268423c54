"""The cumulative sum test: small faults that last, which no single epoch shows.

A chi-square statistic lambda on m degrees of freedom becomes a standard normal score, z = Phi^-1(F_m(lambda)), of the
same law whatever m is, and independent from epoch to epoch when lambda is that of a Kalman filter's innovations. Then

    g <- max(0, g + z - k),      alarm when g >= h.

k, the reference, is half the mean score that is to be found quickest. h is chosen so that in the long run a fraction
p_fa of all epochs is above it: the stationary law of g is computed by a Markov chain on a fine grid, exactly as Brook
and Evans compute run lengths. g is not restarted by an alarm but held at `ceiling` h, so that it tells, within h / k
epochs or so, that a fault is over.

Sources: E.S. Page, Continuous inspection schemes, Biometrika 41 (1954); D. Brook and D.A. Evans, An approach to the
probability distribution of cusum run length, Biometrika 59 (1972).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import chdtrc, ndtr, ndtri

from ftcore.detection.result import Array, Ints, TestResult

LEAST_P_FA, MOST_P_FA = 1e-12, 0.1
"""False-alarm probabilities that the law of the sum is computed for; a form that offers the test has these bounds."""
SCORE_LIMIT = 8.0
"""Scores are held within this: a chi-square probability below 6e-16 is a certainty, not a size."""


@dataclass(frozen=True, slots=True)
class Rules:
    """How the sum is kept. Raises ValueError, naming the value, for rules that cannot work."""

    p_fa: float = 1e-3
    """Part of all epochs without a fault that alarm."""
    reference: float = 0.5
    """k, in standard deviations of the score."""
    ceiling: float = 2.0
    """The sum is held at so many thresholds."""

    def __post_init__(self) -> None:
        """Refuse a sum that drifts up by itself or can never alarm."""
        if not LEAST_P_FA <= self.p_fa <= MOST_P_FA:
            raise ValueError(
                f"the false-alarm probability of a cumulative sum is {LEAST_P_FA:g} to {MOST_P_FA:g}, not {self.p_fa}"
            )
        if not 0.05 <= self.reference <= 4.0:
            raise ValueError(f"the reference is 0.05 to 4 standard deviations, not {self.reference}")
        if not self.ceiling >= 1.0:
            raise ValueError(f"the ceiling is at least one threshold, not {self.ceiling}")

    @property
    def threshold(self) -> float:
        """h for this p_fa and reference."""
        return stationary_threshold(self.p_fa, self.reference)


def start(runs: int) -> Array:
    """The sums before the first epoch, (runs,)."""
    return np.zeros(runs)


def score(statistic: Array, dof: Ints) -> Array:
    """Standard normal score of chi-square statistics, any shape: large for large ones; 0 where dof is 0."""
    # The upper tail is the one that must be exact: scipy's chdtrc keeps it down to 1e-300.
    z = -ndtri(chdtrc(np.maximum(dof, 1), statistic))
    return np.asarray(np.where(dof > 0, np.clip(z, -SCORE_LIMIT, SCORE_LIMIT), 0.0))


def step(
    g: Array, statistic: Array, dof: Ints, rules: Rules, subject: str, name: str = "cusum"
) -> tuple[Array, TestResult]:
    """One epoch: the new sums, and the test.

    g, statistic and dof (runs,): the statistic of another test, chi-square on dof while nothing has failed, and
    independent from epoch to epoch (`residual`). Where dof is 0 there was no measurement and the sum stays. The
    result's dof is 1, for the score; `extra["score"]` is z.
    """
    dof = np.broadcast_to(dof, statistic.shape)
    z = score(statistic, dof)
    h = rules.threshold
    judged = dof > 0
    g = np.where(judged, np.clip(g + z - rules.reference, 0.0, rules.ceiling * h), g)
    return g, TestResult(name, subject, g, judged.astype(np.int64), np.full(g.shape, h), g >= h, extra={"score": z})


@lru_cache(maxsize=64)
def stationary_threshold(p_fa: float, reference: float) -> float:
    """h such that the sum, without a fault and after long, is at h or above with probability `p_fa`.

    The sum's law satisfies pi = pi T, with T the transition matrix between the cells of a grid over [0, L]. Its tail
    falls as exp(-2 k g); L is where that is 1e-7 of p_fa, and cells of 0.05 give h to 0.01.
    """
    length = (16.0 - np.log(p_fa)) / (2.0 * reference)
    cells = int(np.clip(length / 0.05, 200, 1500))
    width = length / cells
    # Cell 0 is the sum at rest, exactly 0; cell i the interval of `width` about i * width. From a cell's middle the
    # next sum is that plus a normal step of mean -k; all below half a cell counts as rest.
    middle = width * np.arange(cells)
    edge = width * (np.arange(cells + 1) - 0.5)
    below = ndtr(edge[None, :] - middle[:, None] + reference)
    below[:, 0] = 0.0
    below[:, -1] = 1.0
    T = np.diff(below, axis=1)
    # pi (T - I) = 0 with one equation replaced by sum(pi) = 1.
    A = (T - np.eye(cells)).T
    A[-1] = 1.0
    pi = np.linalg.solve(A, np.eye(cells)[-1])
    above = np.cumsum(pi[::-1])[::-1]  # probability of the cell or beyond: of g >= edge
    at = int(np.searchsorted(-above, -p_fa))
    low, high = np.log(above[at - 1]), np.log(above[at])
    return float(edge[at - 1] + width * (low - np.log(p_fa)) / (low - high))
