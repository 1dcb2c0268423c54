"""RINEX 2 and 3 navigation files: the broadcast ephemerides of GPS and the coefficients of the ionosphere.

Records of other systems are passed over whatever their length (GLONASS has four lines, from RINEX 3.05 on five). A set
that lacks a number, or whose orbit no GPS satellite can have, is left out and said; a number that cannot be read is an
error of the file.
Source: RINEX 2.11, tables A3 and A4; RINEX 3.05, tables A5 and A6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ftcore.sensors import broadcast, rinex_text
from ftcore.sensors.broadcast import WEEK, Ephemerides
from ftcore.sensors.rinex_observation import PRNS
from ftcore.sensors.rinex_text import FIRST, NAVIGATION, Array, Record, Text, refusal

LINES: Final = 8
"""Lines of a GPS record."""
_SYSTEMS: Final = "GRSECJI"
_ORDER: Final = (
    *("SVclockBias", "SVclockDrift", "SVclockDriftRate"),
    *("IODE", "Crs", "DeltaN", "M0"),
    *("Cuc", "Eccentricity", "Cus", "sqrtA"),
    *("Toe", "Cic", "Omega0", "Cis"),
    *("Io", "Crc", "omega", "OmegaDot"),
    *("IDOT", "CodesL2", "GPSWeek", "L2Pflag"),
    *("SVacc", "health", "TGD", "IODC"),
    *("TransTime", "FitIntvl", "spare0", "spare1"),
)
_ASSUMED: Final = {"health": "healthy", "TGD": "without group delay"}
"""Fields that a set can do without, and what it then counts as."""
_HEARD: Final = 86400.0
"""A time of transmission further than this from the time of ephemeris [s] is none."""


@dataclass(frozen=True)
class Navigation:
    """Ephemerides of a navigation file, and what a person has to know of the reading."""

    ephemerides: Ephemerides
    notes: tuple[str, ...]


def read(content: bytes) -> Navigation:
    """Read a navigation file, plain text.

    Raises:
        LogError: it cannot be read.
    """
    text = Text(content, NAVIGATION)
    first = text.skip_blank(0)
    records, at = text.header(first)
    version = int(rinex_text.version_of(records[0], NAVIGATION, "N"))
    ionosphere = _ionosphere(records, version)
    found: list[_Set] = []
    notes: list[str] = []
    while (at := text.skip_blank(at)) < len(text):
        if text.label(at) == FIRST:
            records, at = text.header(at)
            other = int(rinex_text.version_of(records[0], NAVIGATION, "N"))
            if other != version:
                raise text.corrupt(at, f"a header of RINEX {other} stands in a file of RINEX {version}")
            ionosphere = _ionosphere(records, version) if ionosphere is None else ionosphere
            continue
        system = "G" if version == 2 else text.line(at)[:1].upper()
        if system not in _SYSTEMS:
            raise text.corrupt(at, "a satellite's record was expected")
        if system == "G":
            at = _gps(text, at, version, found, notes)
        else:
            at += 1
            while at < len(text) and not text.line(at)[:1].strip():
                at += 1
    if not found:
        why = f": {notes[0]}" if notes else ""
        raise refusal(NAVIGATION, f"holds no ephemeris of a GPS satellite{why}")
    if ionosphere is None:
        notes.append("the navigation file has no coefficients of the ionosphere: its delay is not taken out")
    return Navigation(_ephemerides(found, ionosphere), tuple(notes))


@dataclass(frozen=True)
class _Set:
    """One record: satellite, reference time of the clock [s], numbers in the file's order."""

    prn: int
    toc: float
    values: dict[str, float]
    transmission: float | None


def _gps(text: Text, at: int, version: int, found: list[_Set], notes: list[str]) -> int:
    """Read the record that begins at a line; returns the line after it."""
    rows = text.records(at, LINES).tolist()
    start, margin = (22, 3) if version == 2 else (23, 4)
    head = text.line(at)
    name = rinex_text.whole(head[:2] if version == 2 else head[1:3])
    stamp = head[2:22] if version == 2 else head[4:23]
    toc = rinex_text.seconds_of(_moment(stamp, version), version == 2)
    if name is None or toc is None:
        raise text.corrupt(at, "a satellite's number and the time of its clock were expected")
    numbers: list[float | None] = []
    for k, row in enumerate(rows):
        line = text.line(row)
        if k and line[:margin].strip():
            raise text.corrupt(row, f"the record of G{name:02d} has only {k} of {LINES} lines")
        first = start if k == 0 else margin
        for column in range(first, first + 19 * (3 if k == 0 else 4), 19):
            field = line[column : column + 19]
            value = rinex_text.number(field)
            cut = row == len(text) - 1 and not text.whole and 0 < len(field) < 19
            if field.strip() and (value is None or cut):
                raise text.truncated() if cut else text.corrupt(row, f"the record of G{name:02d} holds no number there")
            numbers.append(value)
    values = dict(zip(_ORDER, numbers, strict=True))
    if values["TransTime"] is None and rows[-1] == len(text) - 1 and not text.whole:
        raise text.truncated()
    complaint = _complaint(name, values)
    where = f"the ephemeris of G{name:02d} at line {at + 1} of the navigation file"
    if complaint is not None:
        notes.append(f"{where} {complaint}; it is left out")
    else:
        for what, meaning in _ASSUMED.items():
            if values[what] is None:
                notes.append(f"{where} says no {what}; it counts as {meaning}")
        chosen = {what: float(values[what] or 0.0) for what in broadcast.FIELDS}
        found.append(_Set(name, toc, chosen, values["TransTime"]))
    return int(rows[-1]) + 1


def _moment(stamp: str, version: int) -> list[str]:
    """Year to second of a clock's reference time."""
    if version == 2:  # 1X,I2.2,4(1X,I2),F5.1
        return [stamp[1:3], stamp[4:6], stamp[7:9], stamp[10:12], stamp[13:15], stamp[15:20]]
    return [stamp[0:4], stamp[5:7], stamp[8:10], stamp[11:13], stamp[14:16], stamp[17:19]]


def _complaint(prn: int, values: dict[str, float | None]) -> str | None:
    """Why a set cannot be used, None if it can."""
    if not 1 <= prn <= PRNS:
        return f"is of no satellite from G01 to G{PRNS}"
    missing = [name for name in broadcast.FIELDS if values[name] is None and name not in _ASSUMED]
    if missing:
        return f"lacks its {missing[0]}"
    size, shape, toe = (float(values[name] or 0.0) for name in ("sqrtA", "Eccentricity", "Toe"))
    # Semi-major axes of 20 000 to 35 000 km: a GPS satellite's is 26 560 km.
    if not (4470.0 < size < 5920.0 and 0.0 <= shape < 0.3 and -1.0 <= toe <= WEEK):
        return "holds an orbit that no GPS satellite can have"
    return None


def _ephemerides(found: list[_Set], ionosphere: Array | None) -> Ephemerides:
    values = {name: np.array([one.values[name] for one in found]) for name in broadcast.FIELDS}
    toc = np.array([one.toc for one in found])
    toe = values["Toe"] + WEEK * np.round((toc - values["Toe"]) / WEEK)
    heard = np.array([np.nan if one.transmission is None else one.transmission for one in found])
    # Seconds of a week, of the week before where the set was sent then; 9.999e8 where a writer does not know.
    since = heard - values["Toe"]
    since = np.where(np.abs(since) < 2.0 * WEEK, since - WEEK * np.round(since / WEEK), np.nan)
    sent = np.where(np.abs(since) <= _HEARD, toe + since, toe - broadcast.FIT)
    return Ephemerides(
        prn=np.array([one.prn for one in found], dtype=np.int64),
        toc=toc,
        toe=toe,
        sent=sent,
        week_second=values["Toe"],
        values=values,
        ionosphere=ionosphere,
    )


def _ionosphere(records: list[Record], version: int) -> Array | None:
    """Klobuchar's coefficients of a header, (8,), or None where it has not both sets of four."""
    sets: dict[str, list[float]] = {}
    for record in records:
        if version == 2 and record.label in ("ION ALPHA", "ION BETA"):
            name, first = record.label[4:5], 2
        elif version == 3 and record.label == "IONOSPHERIC CORR" and record.content[:4].upper() in ("GPSA", "GPSB"):
            name, first = record.content[3].upper(), 5
        else:
            continue
        numbers = [rinex_text.number(record.content[k : k + 12]) for k in range(first, first + 48, 12)]
        known = [value for value in numbers if value is not None]
        if len(known) == 4 and name not in sets:
            sets[name] = known
    return np.array(sets["A"] + sets["B"]) if len(sets) == 2 else None
