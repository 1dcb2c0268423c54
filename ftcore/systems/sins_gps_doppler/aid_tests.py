"""All tests on GPS and Doppler at once: residual, state chi-square, two-propagator, windowed GLR, CUSUM.

They run on the filters that are not inflated and never see the other sensor, so that their statistics are what theory
says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Chart, Probability, Test, Trace
from ftcore.detection import chi_square, cusum, likelihood_ratio
from ftcore.estimation.kalman import Innovation, Update
from ftcore.parts.charts import chart_of_test
from ftcore.parts.declared import OF_TEST, Declared
from ftcore.parts.ledger import Ledger
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.aids import AIDS
from ftcore.systems.sins_gps_doppler.bank import ALONE, PRIOR, Filters

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

GLR_WINDOW = 10
"""Onsets that the likelihood ratio considers [epochs]."""


def _test(name: str, label: str, dof: str, source: str, probability: Probability, note: str = "") -> Test:
    return Test(
        name=name,
        label=label,
        subjects=("{aid}",),
        dof=dof,
        source=source,
        reference=("imu", "altimeter"),
        probability=probability,
        probability_note=note,
    )


def _both(test: str, label: str) -> Chart:
    """One test of both aids: a fault of either is seen in the first charts."""
    traces = tuple(
        Trace(signal=f"test.{test}.{subject}.{part}", label=name + words, role=part)  # type: ignore[arg-type]
        for part, words in (("statistic", ""), ("threshold", " threshold"))
        for subject, name in AIDS.items()
    )
    return Chart(id=f"{test}-aids", title=f"{label}, both aids", unit="1", group="tests", scale="log", traces=traces)


TESTS: Final = (
    _test("residual", "residual test", "number of measurements", "Zhang 1992 (56)-(57)", "exact"),
    _test(
        "state",
        "state chi-square test",
        "rank of P2 - P1",
        "Zhang 1992 (48)-(52), rank-aware",
        "exact",
        "in any one epoch; the epochs of a run are alike, so alarms are few and last long",
    ),
    _test(
        "two-propagator",
        "two-propagator test",
        "number of measurements",
        "Yang 2016, innovation form",
        "bounded",
        "at 0.4 to 1 of the stated probability: the epochs of a run share the error of the reference",
    ),
    _test(
        "glr",
        "windowed GLR",
        "1 for each onset and channel",
        "Willsky and Jones",
        "bounded",
        "the largest of many likelihood ratios, as if they were independent (Sidak)",
    ),
    _test("cusum", "CUSUM", "1 (normal scores of the residual statistic)", "Page; Brook and Evans", "exact"),
)
DECLARED: Final = Declared(
    tests=TESTS,
    charts=(
        _both("residual", "Residual test"),
        _both("state", "State chi-square test"),
        *(chart_of_test(f"{t.name}-{{aid}}", f"{t.label}, {{aid}}", f"test.{t.name}.{{aid}}") for t in TESTS),
    ),
)


class Columns(Protocol):
    """What the tests need to know of a measurement: H ``(runs, 2, m, n)``, valid ``(runs, m)``, ids of its columns."""

    @property
    def H(self) -> Array:
        """Measurement matrix."""

    @property
    def valid(self) -> Flags:
        """Rows with a reading."""

    @property
    def columns(self) -> Ints:
        """Ids."""


@dataclass(frozen=True)
class AidTestState:
    """What the tests carry from epoch to epoch: likelihood ratios of GPS and Doppler, sums ``(runs, 2)``."""

    glr: tuple[likelihood_ratio.State, ...]
    cusum: Array


@dataclass(frozen=True)
class Found:
    """What one test says of GPS and Doppler, ``(runs, 2)`` each; NaN and 0 where it has nothing to judge."""

    statistic: Array
    threshold: Array
    dof: Array
    alarm: Flags


@dataclass(frozen=True)
class AidTestResult:
    """What every test says, by its name; and whom the likelihood ratio suspects: column id, size, and epochs since the
    onset ``(runs, 2)``."""

    found: Mapping[str, Found]
    culprit: Ints
    size: Array
    age: Ints


class AidTests:
    """The five tests on the two aiding sensors."""

    def __init__(self, runs: int, states: int) -> None:
        self._runs, self._states = runs, states

    def initial(self) -> AidTestState:
        """Nothing seen."""
        nothing = likelihood_ratio.start(self._states, GLR_WINDOW)
        return AidTestState((nothing, nothing), np.zeros((self._runs, 2)))

    def step(
        self,
        state: AidTestState,
        updates: Sequence[Update],
        predictions: Sequence[Innovation],
        aids: Sequence[Columns],
        Phi: Array,
        filters: Filters,
        p_fa: float,
    ) -> tuple[AidTestState, AidTestResult]:
        """One epoch.

        Args:
            updates: of GPS and Doppler, leading axes ``(runs, filters)`` with the filter that is alone first.
            predictions: against fused estimate and reference propagator, ``(runs, 2)``.
            aids: the measurements.
            Phi: transition ``(runs, 21, 21)`` of the epoch.
            filters: after the updates.
            p_fa: false-alarm probability of each test.
        """
        residual = np.stack([u.statistic[:, 0] for u in updates], axis=-1)
        m = np.empty(residual.shape, np.int64)
        for j, update in enumerate(updates):
            m[:, j] = update.dof[:, 0]
        q = np.stack([p.statistic[:, 1] for p in predictions], axis=-1)
        states = [
            chi_square.state_chi_square(
                filters.x[:, ALONE[j]], filters.P[:, ALONE[j]], filters.x[:, PRIOR[j]], filters.P[:, PRIOR[j]], p_fa, ""
            )
            for j in range(2)
        ]
        ratios = tuple(
            likelihood_ratio.step(ratio, _alone(update), Phi, aid.H[:, 0], aid.columns, aid.valid)
            for ratio, update, aid in zip(state.glr, updates, aids, strict=True)
        )
        glr = [likelihood_ratio.glr_test(ratio, p_fa, "") for ratio in ratios]
        sums, summed = cusum.step(state.cusum, residual, m, cusum.Rules(p_fa), "")
        state_rank = np.stack([t.dof for t in states], axis=-1)
        squares = {
            "residual": (residual, m),
            "state": (np.stack([t.statistic for t in states], axis=-1), state_rank),
            "two-propagator": (q, m),
        }
        found = {name: _found(*pair, *chi_square.decide(*pair, p_fa)[1:]) for name, pair in squares.items()}
        several = {"glr": tuple(np.stack([getattr(t, part) for t in glr], axis=-1) for part in OF_TEST)}
        several["cusum"] = tuple(getattr(summed, part) for part in OF_TEST)
        for name, (statistic, threshold, dof, alarm) in several.items():
            found[name] = _found(statistic, dof, threshold, alarm)
        result = AidTestResult(
            found=found,
            culprit=np.stack([np.where(t.alarm, t.extra["column"], -1) for t in glr], axis=-1),
            size=np.stack([t.extra["size"] for t in glr], axis=-1),
            age=np.stack([t.extra["age"] for t in glr], axis=-1),
        )
        return AidTestState(ratios, sums), result

    def reset(self, state: AidTestState, where: Flags) -> AidTestState:
        """Forget what a contaminated filter said: ``where (runs, 2)``."""
        ratios = tuple(likelihood_ratio.reset(ratio, where[:, j]) for j, ratio in enumerate(state.glr))
        return AidTestState(ratios, np.where(where, 0.0, state.cusum))


def report(say: Ledger, result: AidTestResult) -> None:
    """Every test of both aids."""
    for name, found in result.found.items():
        say.test(name, "{aid}", found.statistic, found.threshold, found.dof, found.alarm)


def _found(statistic: Array, dof: NDArray[Any], threshold: Array, alarm: Flags) -> Found:
    tested = dof > 0  # a test without a reading has no statistic: a gap, not a zero
    nothing = np.nan
    return Found(np.where(tested, statistic, nothing), np.where(tested, threshold, nothing), dof.astype(float), alarm)


def _alone(update: Update) -> Update:
    """The update of the filter that is alone, ``(runs, ...)``, out of a bank of updates."""
    return Update(**{field.name: getattr(update, field.name)[:, 0] for field in fields(Update)})
