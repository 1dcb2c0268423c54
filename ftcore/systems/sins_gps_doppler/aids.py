"""The aiding sensors of one epoch, as the filters want them: measurement, its matrix and noise, and what is valid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.estimation.strapdown import InsState
from ftcore.readings import Readings
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler import bank, measurements
from ftcore.systems.sins_gps_doppler.forms import Aiding
from ftcore.systems.sins_gps_doppler.names import SLOTS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Aid:
    """One aiding sensor at one epoch.

    Attributes:
        y, H: ``(runs, 2, m)`` and ``(runs, 2, m, 21)``, against the protected and the unprotected strapdown.
        R: ``(1, 1, m)`` variances.
        present: ``(runs or 1, m)`` rows with a reading.
        valid: the same, less what was excluded before any filter saw it; the unprotected filter takes it all the same.
        columns: ``(m,)`` ids of the rows.
    """

    y: Array
    H: Array
    R: Array
    present: Flags
    valid: Flags
    columns: NDArray[np.int64]

    def of(self, filters: list[int]) -> tuple[Array, Array, Array, Flags]:
        """y, H, R, valid for some filters of the bank."""
        ins = bank.INS_OF_FILTER[filters]
        valid = self.valid[:, None]
        if self.valid is not self.present:
            valid = np.where((ins == 0)[:, None], valid, self.present[:, None])
        return self.y[:, ins], self.H[:, ins], self.R, valid


def gps(a: Aiding, ins: InsState, readings: Readings, runs: int, enabled: bool) -> tuple[Aid, Array]:
    """Pseudoranges, then delta pseudoranges, of the satellites that any run has; and the lines of sight of run 0.

    ``ins`` leads with ``(2 runs,)``. The lines are ``(satellites, 3)``, NaN where there is no reading.
    """
    ranges, rates = readings["gps.pseudorange"], readings["gps.delta_range"]
    seen = np.flatnonzero((ranges.valid | rates.valid).any(axis=0))
    columns = seen if len(seen) else np.array([0])
    satellites, velocities = readings.aiding["satellites"][columns], readings.aiding["velocities"][columns]
    y_range, y_rate = (np.repeat(np.nan_to_num(g.values[:, columns]), 2, axis=0) for g in (ranges, rates))
    measurement, geometry = measurements.gps(ins, satellites, velocities, y_range, y_rate)
    there = np.broadcast_arrays(ranges.valid[:, columns], rates.valid[:, columns])
    valid = np.concatenate(there, axis=-1) & enabled
    m = 2 * len(columns)
    aid = Aid(
        measurement.y.reshape(runs, 2, m),
        measurement.H.reshape(runs, 2, m, -1),
        np.repeat([a.pseudorange**2, a.delta_range**2], len(columns))[None, None],
        valid,
        valid,
        np.concatenate([columns, columns + len(SLOTS)]),
    )
    lines = np.full((len(SLOTS), 3), np.nan)
    usable = ranges.valid[0, columns] | rates.valid[0, columns]
    lines[columns[usable]] = geometry.e_n[0][usable]
    return aid, lines


def doppler(a: Aiding, ins: InsState, readings: Readings, runs: int, enabled: bool) -> Aid:
    """Doppler rows, body axes; ``ins`` leads with ``(2 runs,)``."""
    group = readings["doppler.velocity"]
    valid = group.valid & enabled
    values = np.nan_to_num(np.where(valid, group.values, 0.0))
    measurement = measurements.doppler(ins, np.repeat(values, 2, axis=0))
    R = np.full((1, 1, 3), a.doppler**2)
    return Aid(measurement.y.reshape(runs, 2, 3), measurement.H.reshape(runs, 2, 3, -1), R, valid, valid, np.arange(3))


def hdop(aid: Aid) -> Array:
    """Horizontal dilution of precision ``(runs,)`` of the valid satellites of a GPS aid; NaN where it has no fix."""
    satellites = len(aid.columns) // 2
    e_n = aid.H[:, 0, :satellites, :3]
    G = np.concatenate([e_n, np.ones_like(e_n[..., :1])], axis=-1) * aid.valid[:, :satellites, None]
    normal = G.swapaxes(-1, -2) @ G
    solvable = np.linalg.det(normal) > 1e-9
    cofactor = np.linalg.inv(np.where(solvable[:, None, None], normal, np.eye(4)))
    return np.where(solvable, np.sqrt(np.abs(cofactor[:, 0, 0] + cofactor[:, 1, 1])), np.nan)
