"""The sequential probability ratio test: a shift of known size, decided as soon as the readings suffice.

A chi-square statistic lambda on m degrees of freedom becomes a standard normal score z, as for the cumulative sum
(:func:`ftcore.detection.cusum.score`). Without a fault z has mean 0, with the fault that is to be found mean `shift`.
The logarithm of their likelihood ratio,

    L <- L + shift z - shift^2 / 2,

is compared with two bounds, A = ln((1 - missed) / false) and B = ln(missed / (1 - false)). At A a fault is decided:
alarm. At B none is: the ratio starts anew, at 0. While the readings go on speaking for the fault L is held at A, and
the alarm stays; it ends with the first reading that speaks against it.

`false` and `missed` are probabilities of a decision, not of an epoch: of the decisions without a fault at most
false / (1 - missed) are alarms (Wald's bound). The mean number of readings to a decision is near
((1 - false) B + false A) / (-shift^2 / 2) without a fault and (missed B + (1 - missed) A) / (shift^2 / 2) with it,
where the overshoot of the bounds is left out.

Source: A. Wald, Sequential tests of statistical hypotheses, Annals of Mathematical Statistics 16 (1945).
"""

from dataclasses import dataclass

import numpy as np

from ftcore.detection.cusum import score
from ftcore.detection.result import Array, Ints, TestResult


@dataclass(frozen=True, slots=True)
class Rules:
    """What is to be found, and how surely. Raises ValueError, naming the value, for rules that cannot work."""

    shift: float = 1.0
    """Mean of the score with the fault that is to be found."""
    false: float = 1e-3
    """Probability that a decision without a fault is an alarm."""
    missed: float = 1e-2
    """Probability that a decision with the fault is none."""

    def __post_init__(self) -> None:
        """Refuse bounds that are not on either side of zero."""
        if not 0.05 <= self.shift <= 10.0:
            raise ValueError(f"the shift is 0.05 to 10 standard deviations, not {self.shift}")
        if not (0.0 < self.false < 1.0 and 0.0 < self.missed < 1.0 and self.false + self.missed < 1.0):
            raise ValueError(
                f"the probabilities of error lie between 0 and 1 and sum to less than 1, not {self.false} and "
                f"{self.missed}"
            )

    @property
    def upper(self) -> float:
        """A: at or above it a fault is decided."""
        return float(np.log((1.0 - self.missed) / self.false))

    @property
    def lower(self) -> float:
        """B: at or below it no fault is decided."""
        return float(np.log(self.missed / (1.0 - self.false)))

    def sample_number(self, fault: bool) -> float:
        """Mean number of readings to a decision, without the overshoot of the bounds."""
        alarm = 1.0 - self.missed if fault else self.false
        drift = self.shift**2 / 2.0 * (1.0 if fault else -1.0)
        return (alarm * self.upper + (1.0 - alarm) * self.lower) / drift


def start(runs: int) -> Array:
    """The logarithms of the ratio before the first epoch, (runs,)."""
    return np.zeros(runs)


def step(
    ratio: Array, statistic: Array, dof: Ints, rules: Rules, subject: str, name: str = "sprt"
) -> tuple[Array, TestResult]:
    """One epoch: the new ratios, and the test.

    ratio, statistic and dof of one shape, (runs,) or (runs, subjects): the statistic of another test, chi-square on dof
    while nothing has failed and independent from epoch to epoch (`residual`). Where dof is 0 there was no measurement
    and the ratio stays. The result's statistic is L before it starts anew, its dof 1, for the score; `extra["decided"]`
    says where a bound was reached.
    """
    dof = np.broadcast_to(dof, statistic.shape)
    judged = dof > 0
    z = score(statistic, dof)
    reached = np.where(judged, ratio + rules.shift * (z - rules.shift / 2.0), ratio)
    alarm = judged & (reached >= rules.upper)
    none = judged & (reached <= rules.lower)
    after = np.where(none, 0.0, np.minimum(reached, rules.upper))
    shown = np.minimum(reached, rules.upper)
    limit = np.full(shown.shape, rules.upper)
    return after, TestResult(
        name, subject, shown, judged.astype(np.int64), limit, alarm, extra={"decided": alarm | none}
    )
