"""Bands in which a right program's numbers lie, and how likely they do not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, chi2, norm, poisson

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def binomial_band(trials: int, probability: float, outside: float) -> tuple[int, int]:
    """Counts of a binomial variable that are exceeded, and undercut, with probability `outside` / 2 at most."""
    low, high = binom.ppf([outside / 2, 1 - outside / 2], trials, probability)
    return int(low), int(high)


def most(trials: int, probability: float, outside: float) -> int:
    """The count that a binomial variable exceeds with probability `outside` at most."""
    return int(binom.isf(outside, trials, probability))


def cluster_size(alarms: Flags) -> float:
    """How many alarms ``(epochs, runs)`` come together, in the sense that matters for their spread: E[k^2] / E[k] of
    a run's count k. One, when epochs are independent and alarms rare."""
    counts = alarms.sum(axis=0).astype(float)
    return float(np.square(counts).sum() / counts.sum()) if counts.any() else 1.0


def likeness(score: Array, level: float = 0.05) -> float:
    """By how much the spread of a run's count of high scores ``(epochs, runs)`` exceeds that of independent epochs.

    High are those beyond the quantile of `level`: common enough to be counted where alarms are too rare to show how
    they cluster. The higher the level of an excursion, the shorter it lasts, so this is no less than for alarms.
    """
    counts = (score > np.quantile(score, 1.0 - level)).sum(axis=0)
    return float(np.var(counts, ddof=1) / (np.mean(counts) * (1.0 - level)))


def clustered_band(trials: int, probability: float, size: float, outside: float) -> tuple[float, float]:
    """Counts when alarms come in clusters of a run: runs are the independent units, clusters are Poisson, and a sum of
    clusters of effective size `size` has the law of `size` times a Poisson variable in mean, variance and (nearly)
    skewness. Wider than the binomial by the root of `size`."""
    low, high = poisson.ppf([outside / 2, 1 - outside / 2], trials * probability / size)
    return float(low * size), float(high * size)


def mean_band(dof: float, samples: int, outside: float) -> tuple[float, float]:
    """Mean of independent chi-square variables, over their degrees of freedom."""
    low, high = chi2.ppf([outside / 2, 1 - outside / 2], dof * samples) / (dof * samples)
    return float(low), float(high)


def sum_band(probabilities: Array, outside: float) -> tuple[float, float]:
    """How many of many independent events of these probabilities happen (normal, with correction for continuity)."""
    mean, variance = probabilities.sum(), (probabilities * (1 - probabilities)).sum()
    half = norm.isf(outside / 2) * np.sqrt(variance) + 0.5
    return float(mean - half), float(mean + half)
