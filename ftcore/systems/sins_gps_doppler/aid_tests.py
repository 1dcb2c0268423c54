"""All tests on GPS and Doppler at once: residual, state chi-square, two-propagator, windowed GLR, CUSUM.

They run on the filters that are not inflated and never see the other sensor, so that their statistics are what theory
says. Columns are test-major: residual gps, residual doppler, state gps, ...
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import chi_square, cusum, likelihood_ratio
from ftcore.estimation.kalman import Innovation, Update
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.bank import ALONE, PRIOR, Filters

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

GLR_WINDOW = 10
"""Onsets that the likelihood ratio considers [epochs]."""


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
class AidTestResult:
    """``(runs, 10)`` each; and whom the likelihood ratio suspects: column id, size, and epochs since the onset
    ``(runs, 2)``."""

    statistic: Array
    threshold: Array
    dof: Array
    alarm: Flags
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
        squares = np.concatenate([residual, states[0].statistic[:, None], states[1].statistic[:, None], q], axis=-1)
        rank = np.concatenate([m, states[0].dof[:, None], states[1].dof[:, None], m], axis=-1)
        rank, limit, alarm = chi_square.decide(squares, rank, p_fa)
        others = [*glr, summed]
        result = AidTestResult(
            statistic=np.concatenate([squares, *(_columns(t.statistic) for t in others)], axis=-1),
            threshold=np.concatenate(
                [limit, *(_columns(np.where(t.dof > 0, t.threshold, 0.0)) for t in others)], axis=-1
            ),
            dof=np.concatenate([rank, *(_columns(t.dof) for t in others)], axis=-1).astype(np.float64),
            alarm=np.concatenate([alarm, *(_columns(t.alarm) for t in others)], axis=-1),
            culprit=np.stack([np.where(t.alarm, t.extra["column"], -1) for t in glr], axis=-1),
            size=np.stack([t.extra["size"] for t in glr], axis=-1),
            age=np.stack([t.extra["age"] for t in glr], axis=-1),
        )
        return AidTestState(ratios, sums), result

    def reset(self, state: AidTestState, where: Flags) -> AidTestState:
        """Forget what a contaminated filter said: ``where (runs, 2)``."""
        ratios = tuple(likelihood_ratio.reset(ratio, where[:, j]) for j, ratio in enumerate(state.glr))
        return AidTestState(ratios, np.where(where, 0.0, state.cusum))


def _columns(array: NDArray[Any]) -> NDArray[Any]:
    """``(runs,)`` or ``(runs, k)`` as columns."""
    return array[:, None] if array.ndim == 1 else array


def _alone(update: Update) -> Update:
    """The update of the filter that is alone, ``(runs, ...)``, out of a bank of updates."""
    return Update(**{field.name: getattr(update, field.name)[:, 0] for field in fields(Update)})
