"""Errors and consistency of the estimators, from the rows of the runs."""

from __future__ import annotations

import numpy as np

from ftcore.score.models import ErrorScore, EstimatorScore
from ftcore.score.per_fault import largest
from ftcore.score.tables import Table


def of_estimator(name: str, flights: Table) -> EstimatorScore:
    """One estimator, from when the filters have settled."""

    def error(quantity: str) -> ErrorScore:
        key = f"{name}.{quantity}"
        if f"squares.{key}" not in flights.columns:
            return ErrorScore(rms=None, worst=None)
        worst, epochs = largest(flights[f"worst_square.{key}"]), int(flights[f"epochs.{key}"].sum())
        if worst is None or not epochs:
            return ErrorScore(rms=None, worst=None)
        mean = float(flights[f"squares.{key}"].sum()) / epochs
        return ErrorScore(rms=float(np.sqrt(mean)), worst=float(np.sqrt(worst)))

    has_nees = f"nees.{name}" in flights.columns
    nees = None
    if has_nees and (epochs := int(flights[f"nees_epochs.{name}"].sum())):
        nees = float(flights[f"nees.{name}"].sum()) / epochs
    return EstimatorScore(
        position=error("position"),
        velocity=error("velocity"),
        attitude=error("attitude"),
        nees=nees,
        nees_dof=9 if has_nees else None,
    )
