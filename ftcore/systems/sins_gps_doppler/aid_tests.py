"""All tests on GPS and Doppler at once: residual, state chi-square, two-propagator, windowed GLR, CUSUM.

They run on the filters that are not inflated and never see the other sensor, so that their statistics are what theory
says. Columns are test-major: residual gps, residual doppler, state gps, ...
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import chi_square
from ftcore.estimation.kalman import Innovation, Update
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.bank import ALONE, PRIOR, Filters

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AidTestState:
    """What the tests carry from epoch to epoch."""

    glr: tuple[Any, Any]
    cusum: Array


@dataclass(frozen=True)
class AidTestResult:
    """``(runs, 10)`` each."""

    statistic: Array
    threshold: Array
    dof: Array
    alarm: Flags


class AidTests:
    """The five tests on the two aiding sensors."""

    def __init__(self, runs: int) -> None:
        self._runs = runs

    def initial(self) -> AidTestState:
        """Nothing seen."""
        return AidTestState((None, None), np.zeros((self._runs, 2)))

    def step(
        self,
        state: AidTestState,
        updates: Sequence[Update],
        predictions: Sequence[Innovation],
        aids: Sequence[Any],
        Phi: Array,
        filters: Filters,
        p_fa: float,
    ) -> tuple[AidTestState, AidTestResult]:
        """One epoch.

        Args:
            updates: of GPS and Doppler, leading axes ``(runs, filters)`` with the filter that is alone first.
            predictions: against fused estimate and reference propagator, ``(runs, 2)``.
            aids: measurements, for their column numbers.
            Phi: transition ``(runs, 21, 21)`` of the epoch.
            filters: after the updates.
            p_fa: false-alarm probability of each test.
        """
        residual = np.stack([u.statistic[:, 0] for u in updates], axis=-1)
        m = np.stack([u.dof[:, 0] for u in updates], axis=-1)
        m = np.broadcast_to(m, residual.shape)
        q = np.stack([p.statistic[:, 1] for p in predictions], axis=-1)
        states = [
            chi_square.state_chi_square(
                filters.x[:, ALONE[j]], filters.P[:, ALONE[j]], filters.x[:, PRIOR[j]], filters.P[:, PRIOR[j]], p_fa, ""
            )
            for j in range(2)
        ]
        columns = [
            (residual, m),
            (np.stack([s.statistic for s in states], -1), np.stack([s.dof for s in states], -1)),
            (q, m),
            (np.zeros_like(residual), m * 0),
            (np.zeros_like(residual), m * 0),
        ]
        statistic = np.concatenate([s for s, _ in columns], axis=-1)
        dof = np.concatenate([d for _, d in columns], axis=-1)
        dof, threshold, alarm = chi_square.decide(statistic, dof, p_fa)
        return state, AidTestResult(statistic, threshold, dof.astype(float), alarm)

    def reset(self, state: AidTestState, where: Flags) -> AidTestState:
        """Forget what a contaminated filter said: ``where (runs, 2)``."""
        return replace(state, cusum=np.where(where, 0.0, state.cusum))
