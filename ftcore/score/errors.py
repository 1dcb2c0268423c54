"""Errors and consistency of the estimators."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftcore.recording import Recording
from ftcore.score.models import ErrorScore, EstimatorScore

Array = NDArray[np.float64]

SETTLING = 20.0
"""Seconds at the start that do not count as errors: the filters are still converging."""


def worst(values: Array) -> float | None:
    """Largest absolute value; None where there is no number at all."""
    return float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else None


def of_estimator(name: str, recording: Recording) -> EstimatorScore:
    """One estimator, from when the filters have settled."""
    lo = int(np.searchsorted(recording.time, SETTLING - 1e-9))
    rows = recording.rows[lo:] if len(recording) > lo else recording.rows

    def error(quantity: str) -> ErrorScore:
        prefix = f"{name}.error.{quantity}."
        columns = [i for n, i in recording.column.items() if n.startswith(prefix) and not n.endswith(".horizontal")]
        if not columns or not len(rows):
            return ErrorScore(rms=None, worst=None)
        squared = np.sum(rows[:, :, columns] ** 2, axis=-1)
        if not np.isfinite(squared).any():
            return ErrorScore(rms=None, worst=None)
        return ErrorScore(rms=float(np.sqrt(np.nanmean(squared))), worst=float(np.sqrt(np.nanmax(squared))))

    column = recording.column.get(f"{name}.nees")
    nees = float(np.nanmean(rows[:, :, column])) if column is not None and len(rows) else None
    return EstimatorScore(
        position=error("position"),
        velocity=error("velocity"),
        attitude=error("attitude"),
        nees=nees,
        nees_dof=9 if column is not None else None,
    )
