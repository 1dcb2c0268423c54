"""How large an error could hide in each estimator's set of satellites."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import protection
from ftcore.estimation.least_squares import Fix
from ftcore.systems.base import Flags
from ftcore.systems.gps_receiver.forms import Settings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Protection:
    """Protection of sets of satellites; NaN where nothing is protected.

    ``slope``, ``separation``, ``level`` (runs, sets) [m], the last being the one chosen; ``detectable`` (runs, sets, n)
    minimal detectable biases [m].
    """

    slope: Array
    separation: Array
    level: Array
    detectable: Array


def protect(fix: Fix, sigma: Array, valid: Flags, settings: Settings) -> Protection:
    """Protection of solutions ``fix`` (runs, sets) with ``sigma (runs, n)`` [m]."""
    p_fa, p_md = settings.false_alarm_probability, settings.missed_detection_probability
    if p_fa + p_md >= 1.0:
        p_md = 1.0 - p_fa - 1e-6
    lam = protection.noncentralities(fix.dof, p_fa, p_md)
    steep = protection.slopes(fix.gain, fix.projector, valid)
    slope = protection.slope_level(steep, lam)
    separation = protection.separation_level(steep, fix.gain, fix.covariance, valid, p_fa, p_md)
    separation = np.where(np.isfinite(lam), separation, np.nan)
    return Protection(
        slope=slope,
        separation=separation,
        level=slope if settings.protection == "slope" else separation,
        detectable=protection.minimal_detectable_bias(fix.projector, sigma[:, None], valid, lam),
    )
