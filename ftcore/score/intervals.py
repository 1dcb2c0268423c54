"""Exact intervals of counts, and how they are said.

A share is given with its Clopper-Pearson interval, a rate per hour with the exact one of a Poisson count (Garwood
1936). Both cover the true value with at least the probability stated, whatever it is.
"""

from __future__ import annotations

from scipy.special import betaincinv, gammaincinv

CONFIDENCE = 0.95
"""Probability with which an interval covers the true value, at least."""


def of_share(count: int, of: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Clopper-Pearson interval of a probability, from ``count`` hits in ``of`` independent trials (at least one).

    Raises:
        ValueError: a count that is negative or larger than the trials, or no trials.
    """
    if not 0 <= count <= of or of < 1:
        raise ValueError(f"{count} of {of} is no share; the count is between 0 and the trials, which are at least 1")
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if count == 0 else float(betaincinv(count, of - count + 1, tail))
    high = 1.0 if count == of else float(betaincinv(count + 1, of - count, 1.0 - tail))
    return low, high


def of_rate(count: int, exposure: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Exact interval of a rate, from ``count`` independent events in ``exposure`` (of any unit, positive).

    Raises:
        ValueError: a negative count, or no exposure.
    """
    if count < 0 or not exposure > 0.0:
        raise ValueError(f"{count} events in {exposure:g} give no rate; the exposure must be positive")
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if count == 0 else float(gammaincinv(count, tail))
    return low / exposure, float(gammaincinv(count + 1, 1.0 - tail)) / exposure


def percent(share: float) -> str:
    """A share as a person reads it, without the unit: three digits, and 0 or 100 only where it is exactly that."""
    value = 100.0 * share
    text = f"{value:.3g}"
    return "99.9" if text == "100" and value < 100.0 else text


def between(low: float, high: float) -> str:
    """An interval of a share in words: ``95 %: 55.5 to 99.7 %``."""
    return f"{100 * CONFIDENCE:.0f} %: {percent(low)} to {percent(high)} %"


def figure(rate: float) -> str:
    """A rate as a person reads it: two digits, whole numbers from 100 on."""
    return f"{rate:.0f}" if rate >= 99.5 else f"{rate:.2g}"
