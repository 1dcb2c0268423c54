"""Satellites of the GPS receiver: what is declared of them, and their readings as one linear measurement.

y = H x + e about a working point: corrected pseudoranges minus predicted ranges. Corrections that depend on the
receiver's own position (atmosphere, elevation weights, mask) are made from the working point; truth is not needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore import earth
from ftcore.description import Block, BlockView, Channel, Chart, Subsystem, Trace
from ftcore.estimation import atmosphere, least_squares
from ftcore.faults import ALL_KINDS
from ftcore.parts.declared import Declared, Signals, channels_of
from ftcore.parts.ledger import Ledger
from ftcore.parts.satellites import LINES_OF_SIGHT
from ftcore.readings import Readings
from ftcore.systems.base import Flags
from ftcore.systems.gps_receiver.forms import Parameters
from ftcore.systems.reporting import Now
from ftcore.world.constellation import almanac

Array = NDArray[np.float64]

SLOTS: Final = almanac().names
"""Satellites of the simulated constellation, by their slots."""
PRNS: Final = tuple(f"G{prn:02d}" for prn in range(1, 33))
"""Satellites of a receiver's log."""
SATELLITES: Final = (*SLOTS, *PRNS)
EPOCH: Final = 1.0
"""Seconds between epochs of the simulated receiver; a log has its own."""
LINE: Final = 2.2
"""Length of a line of sight in the scene."""


def chart(id: str, title: str, unit: str, group: str, signal: str) -> Chart:
    """One signal of every satellite; those that are not there have no value and take no room."""
    trace = Trace(signal=signal, label="{satellite}", item="satellite.{satellite}")
    return Chart(id=id, title=title, unit=unit, group=group, traces=(trace,))


DECLARED: Final = Declared(
    members={"satellite": {name: name for name in SATELLITES}},
    channels=(
        *channels_of(
            "gps.pseudorange", "Pseudorange {}", {n: n + " (log)" * (n in PRNS) for n in SATELLITES},
            sensor="gps.{}", unit="m", kinds=ALL_KINDS, typical=100.0,
        ),
        Channel(
            name="gps.pseudorange.all", label="Pseudoranges of all satellites", unit="m", sensor="gps",
            group="gps.pseudorange", parts=tuple(range(len(SATELLITES))), kinds=ALL_KINDS, typical=100.0,
        ),
    ),
    subsystems=(Subsystem(name="gps", label="GPS"),),
    subjects={"gps": "all satellites", "gps.{satellite}": "{satellite}"},
    signals=(
        Signals("gps.satellites", "satellites in view", "1", "geometry"),
        Signals("gps.time", "receiver time, seconds of the GPS week", "s", "geometry"),
        Signals("elevation.{satellite}", "{satellite}: elevation", "deg", "sky"),
        Signals("azimuth.{satellite}", "{satellite}: azimuth", "deg", "sky"),
    ),
    charts=(
        Chart(
            id="sky",
            title="Sky",
            unit="deg",
            group="geometry",
            kind="sky",
            traces=(
                Trace(
                    signal="elevation.{satellite}",
                    across="azimuth.{satellite}",
                    label="{satellite}",
                    item="satellite.{satellite}",
                ),
            ),
        ),
        chart("elevation", "Elevation", "deg", "geometry", "elevation.{satellite}"),
    ),
    blocks=(
        Block(
            id="satellites", label="Satellites", kind="sensor", x=1, y=27, width=20, height=13, sensor="gps",
            subsystem="gps",
        ),
    ),
    scene=(LINES_OF_SIGHT,),
)  # fmt: skip


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


def report(say: Ledger, measured: Pseudoranges, m: Measurement) -> None:
    """What is seen of the satellites, and where."""
    unit_n = np.where(m.valid[..., None], m.unit_n, np.nan)
    say["gps.satellites"] = m.valid.sum(axis=-1)
    say["gps.time"] = [measured.time]
    say["elevation.{satellite}", measured.columns] = least_squares.elevation(unit_n)
    say["azimuth.{satellite}", measured.columns] = least_squares.azimuth(unit_n)
    lines = np.full((len(SATELLITES), 3), np.nan)
    lines[measured.columns] = LINE * unit_n[0]
    say.draw("satellite.{satellite}", lines)


def blocks(now: Now) -> dict[str, BlockView]:
    """The diagram's block of the satellites."""
    broken = sum(name.startswith("gps.") for name in now.faulted)
    if now.health["gps"] == "off":
        return {"satellites": BlockView(health="off", text="off")}
    text = "waiting" if now.said is None else f"{now.said['gps.satellites'][0]:.0f} in view"
    if now.said is not None and broken:
        text += f", {broken} faulted"
    return {"satellites": BlockView(health="faulted" if broken else "ok", text=text)}


def verdict(now: Now, test: str) -> BlockView:
    """The diagram's block of a test of all satellites: whom it names."""
    if now.said is None or now.health["gps"] == "off":
        return BlockView(health="ok", text="waiting")
    alarms = now.said.of_test(test, "gps.{satellite}", "alarm")[0]
    named = [name for name, alarm in zip(SATELLITES, alarms, strict=True) if alarm]
    if not named and not now.said.of_test(test, "gps", "alarm")[0]:
        return BlockView(health="ok", text="passed")
    return BlockView(health="suspect", text=f"{', '.join(named)[:16]} named" if named else "alarm, nobody named")
