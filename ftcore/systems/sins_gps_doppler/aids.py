"""GPS and Doppler: what is declared of them, and their readings of one epoch as the filters want them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Channel, Chart, Subsystem, Trace
from ftcore.estimation import federated
from ftcore.estimation.federated import Estimate
from ftcore.estimation.strapdown import InsState
from ftcore.faults import ALL_KINDS
from ftcore.parts.declared import Declared, Signals, channels_of
from ftcore.parts.ledger import Ledger
from ftcore.readings import Readings
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler import bank, measurements
from ftcore.systems.sins_gps_doppler.forms import Aiding
from ftcore.world.constellation import almanac

Array = NDArray[np.float64]

AIDS: Final = {"gps": "GPS", "doppler": "Doppler"}
"""The two aids that are tested against each other and fused."""
SLOTS: Final = almanac().names
_RANGES: Final = {"pseudorange": ("pseudorange", "m", 100.0), "delta_range": ("delta pseudorange", "m/s", 2.0)}
_BODY: Final = {"x": "forward", "y": "right", "z": "down"}


def _every(group: str, label: str, unit: str, columns: int, typical: float) -> Channel:
    """The channel of all columns of a group."""
    return Channel(
        name=f"{group}.all",
        label=label,
        unit=unit,
        sensor=group.split(".")[0],
        group=group,
        parts=tuple(range(columns)),
        kinds=ALL_KINDS,
        typical=typical,
    )


DECLARED: Final = Declared(
    members={
        "aid": {name: f"SINS/{label}" for name, label in AIDS.items()},
        "satellite": {slot: slot for slot in SLOTS},
        "body": {axis: axis for axis in _BODY},
    },
    channels=(
        *(
            channel
            for quantity, (words, unit, typical) in _RANGES.items()
            for channel in (
                *channels_of(
                    f"gps.{quantity}", f"GPS {words} {{}}", {slot: slot for slot in SLOTS},
                    sensor="gps", unit=unit, kinds=ALL_KINDS, typical=typical,
                ),
                _every(f"gps.{quantity}", f"GPS {words}, all satellites", unit, len(SLOTS), typical),
            )
        ),
        *channels_of(
            "doppler.velocity", "Doppler velocity {}", _BODY, sensor="doppler", unit="m/s", kinds=ALL_KINDS, typical=2.0
        ),
        _every("doppler.velocity", "Doppler velocity, all axes", "m/s", 3, 2.0),
    ),
    subsystems=(Subsystem(name="gps", label="GPS"), Subsystem(name="doppler", label="Doppler")),
    subjects={"{aid}": "{aid}"},
    signals=(
        Signals("used.{aid}", "{aid} used", "1", "decision"),
        Signals("reading.doppler.{body}", "Doppler {body}: reading", "m/s", "output"),
        Signals("estimate.doppler.{body}", "Doppler {body}: estimated output", "m/s", "output"),
        Signals(
            "discrepancy.gps.{satellite}", "pseudorange {satellite}: reading minus estimated output", "m", "output"
        ),
        Signals("gps.satellites", "satellites in use", "1", "geometry"),
        Signals("gps.excluded", "satellites left out", "1", "geometry"),
        Signals("gps.hdop", "HDOP", "1", "geometry"),
    ),
    charts=(
        Chart(
            id="doppler-output",
            title="Doppler forward velocity: reading and estimate",
            unit="m/s",
            group="outputs",
            traces=(
                Trace(signal="estimate.doppler.x", label="estimated output", role="protected"),
                Trace(signal="reading.doppler.x", label="reading", role="local"),
            ),
        ),
        Chart(
            id="gps-discrepancy",
            title="Pseudoranges: reading minus estimated output",
            unit="m",
            group="outputs",
            traces=(Trace(signal="discrepancy.gps.{satellite}", label="{satellite}"),),
        ),
        Chart(
            id="geometry",
            title="Satellites in use and left out, and HDOP",
            unit="1",
            group="outputs",
            traces=(
                Trace(signal="gps.satellites", label="satellites in use"),
                Trace(signal="gps.excluded", label="satellites left out"),
                Trace(signal="gps.hdop", label="HDOP"),
            ),
        ),
    ),
)  # fmt: skip


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


def report(say: Ledger, gps: Aid, doppler: Aid, readings: Readings, fused: Estimate) -> None:
    """Readings beside what the fused estimate says of them, and the satellites."""
    n = len(gps.columns) // 2
    there, taken = gps.present[:, :n], gps.valid[:, :n]
    residual = gps.y[:, 0, :n] - np.matvec(gps.H[:, 0, :n], fused.x)
    say["discrepancy.gps.{satellite}", gps.columns[:n]] = np.where(there, residual, np.nan)
    say["gps.satellites"] = taken.sum(axis=-1)
    say["gps.excluded"] = (there & ~taken).sum(axis=-1)
    say["gps.hdop"] = hdop(gps)
    reading = np.where(doppler.present, readings["doppler.velocity"].values, np.nan)
    output, _ = federated.failed_output(fused, doppler.H[:, 0])
    say["reading.doppler.{body}"] = reading
    say["estimate.doppler.{body}"] = doppler.y[:, 0] + np.nan_to_num(reading) - output


def hdop(aid: Aid) -> Array:
    """Horizontal dilution of precision ``(runs,)`` of the valid satellites of a GPS aid; NaN where it has no fix."""
    satellites = len(aid.columns) // 2
    e_n = aid.H[:, 0, :satellites, :3]
    G = np.concatenate([e_n, np.ones_like(e_n[..., :1])], axis=-1) * aid.valid[:, :satellites, None]
    normal = G.swapaxes(-1, -2) @ G
    solvable = np.linalg.det(normal) > 1e-9
    cofactor = np.linalg.inv(np.where(solvable[:, None, None], normal, np.eye(4)))
    return np.where(solvable, np.sqrt(np.abs(cofactor[:, 0, 0] + cofactor[:, 1, 1])), np.nan)
