"""Readings of one epoch to the linear measurement that all estimators share.

y = H x + e about a working point: corrected pseudoranges minus predicted ranges. Corrections that depend on the
receiver's own position (atmosphere, elevation weights, mask) are made from the working point; truth is not needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore import earth
from ftcore.estimation import atmosphere, least_squares
from ftcore.readings import Readings
from ftcore.systems.base import Flags
from ftcore.systems.gps_receiver.forms import Parameters

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pseudoranges:
    """What the receiver measured, for the satellites that any run has.

    ``columns`` (n,) of the satellites among all names; ``satellites`` (n, 3) or (runs, n, 3) Earth-fixed at
    emission [m]; ``values``
    (runs, n) with the satellite clocks taken out [m]; ``valid`` (runs, n); ``time`` seconds of the GPS week, or
    (runs, 1) of them;
    ``ionosphere`` (8,) or None.
    """

    columns: NDArray[np.intp]
    satellites: Array
    values: Array
    valid: Flags
    time: float | Array
    ionosphere: Array | None


@dataclass(frozen=True)
class Measurement:
    """The linear measurement: y and sigma (runs, n) [m], H (runs, n, 4), valid (runs, n), directions (runs, n, 3)."""

    y: Array
    H: Array
    sigma: Array
    valid: Flags
    unit_n: Array


def pseudoranges(readings: Readings, runs: int, enabled: bool) -> Pseudoranges:
    """Those satellites that any run has; one blind column if there are none."""
    group = readings["gps.pseudorange"]
    seen = np.flatnonzero(group.valid.any(axis=0)) if enabled else np.zeros(0, np.intp)
    columns = seen if len(seen) else np.array([0])
    valid = np.broadcast_to(group.valid[:, columns] & bool(len(seen)), (runs, len(columns)))
    values = np.where(valid, group.values[:, columns] + readings.aiding["clock"][columns], 0.0)
    return Pseudoranges(
        columns=columns,
        satellites=readings.aiding["satellites"][columns],
        values=values,
        valid=valid,
        time=float(readings.aiding["time"]),
        ionosphere=readings.aiding.get("ionosphere"),
    )


def measure(p: Parameters, measured: Pseudoranges, position_e: Array, C_en: Array, known: Flags) -> Measurement:
    """Linearise about ``position_e (runs, 3)``; nothing is valid in runs where that is not ``known (runs,)``."""
    seen = least_squares.geometry(position_e, C_en, measured.satellites)
    y = measured.values - seen.range
    valid = measured.valid & known[:, None]
    if p.log is None:
        sigma = np.broadcast_to(p.receiver.pseudorange, y.shape)
        return Measurement(y, seen.H, sigma, valid, seen.unit_n)
    elevation, azimuth = least_squares.elevation(seen.unit_n), least_squares.azimuth(seen.unit_n)
    lat, lon, height = np.moveaxis(earth.ecef_to_geodetic(position_e), -1, 0)[..., None]
    y = y - atmosphere.saastamoinen(lat, height, elevation)
    if measured.ionosphere is not None:
        y = y - atmosphere.klobuchar(lat, lon, elevation, azimuth, measured.time, measured.ionosphere)
    low = np.maximum(np.sin(elevation), math.sin(math.radians(2.0)))
    sigma = np.sqrt(p.log.floor**2 + (p.log.slant / low) ** 2)
    return Measurement(y, seen.H, sigma, valid & (elevation > math.radians(p.mask)), seen.unit_n)
