"""An ordinary daily file, made for tests: 2880 epochs of half a minute, all systems and signals, some 33 MB.

Its GPS pseudoranges on L1 are numbers that can be told apart, not distances: it is there to be read.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.synthetic_log import ANTENNA, START, files

_SYSTEMS = {"G": 11, "R": 8, "E": 9, "C": 13, "J": 2, "S": 2}
"""Satellites in view at a time."""
_SIGNALS = 16
"""Observables of a satellite."""
_BEFORE = 4
"""Observables before the code on L1."""


@dataclass(frozen=True)
class Daily:
    """Contents of the two files, and the pseudoranges (epochs, 32) that stand in them [m], NaN where there is none."""

    observation: bytes
    navigation: bytes
    pseudorange: np.ndarray


def daily(epochs: int = 2880) -> Daily:
    """So many epochs of it."""
    rng = np.random.default_rng(3)
    codes = [f"{kind}{band}" for band in ("2W", "5Q", "1W", "2L") for kind in "CLDS"]
    gps = [*codes[:_BEFORE], "C1C", *codes[_BEFORE : _SIGNALS - 1]]
    lines = [_header("     3.04           OBSERVATION DATA    M: MIXED", "RINEX VERSION / TYPE")]
    for system in _SYSTEMS:
        names = gps if system == "G" else [f"C{k % 10}{chr(65 + k)}" for k in range(_SIGNALS)]
        for first in range(0, _SIGNALS, 13):
            start = f"{system}  {_SIGNALS:3d} " if first == 0 else " " * 7
            lines.append(_header(start + " ".join(names[first : first + 13]), "SYS / # / OBS TYPES"))
    lines += [
        _header("".join(f"{part:14.4f}" for part in ANTENNA), "APPROX POSITION XYZ"),
        _header(f"{START:  %Y    %m    %d    %H    %M}    0.0000000     GPS", "TIME OF FIRST OBS"),
        _header("", "END OF HEADER"),
    ]
    filler = [f"{value:14.3f} {k % 10}" for k, value in enumerate(rng.uniform(-9e7, 9e7, 4 * _SIGNALS))]
    before, after = "".join(filler[:_BEFORE]), "".join(filler[_BEFORE : _SIGNALS - 1])
    others = [
        f"{system}{k + 1:02d}" + "".join(filler[(k * 3) % _SIGNALS :][:_SIGNALS])
        for system, count in _SYSTEMS.items()
        if system != "G"
        for k in range(count)
    ]
    pseudorange = np.full((epochs, 32), np.nan)
    values = np.round(rng.uniform(2.0e7, 2.6e7, (epochs, _SYSTEMS["G"])), 3)
    for k in range(epochs):
        minute, second = divmod(30 * k, 60)
        hour, minute = divmod(minute, 60)
        day, hour = divmod(START.hour + hour, 24)
        lines.append(
            f"> {START:%Y %m} {START.day + day:02d} {hour:02d} {minute:02d} {second:02d}.0000000  0"
            f"{sum(_SYSTEMS.values()):3d}"
        )
        satellites = (np.arange(_SYSTEMS["G"]) + k // 120) % 24
        pseudorange[k, satellites] = values[k]
        pairs = zip(satellites.tolist(), values[k].tolist(), strict=True)
        lines += [f"G{s + 1:02d}{before}{v:14.3f} 7{after}" for s, v in pairs]
        lines += others
    observation = "\n".join(lines) + "\n"
    return Daily(observation.encode(), files(2, 30.0 * (epochs - 1)).navigation, pseudorange)


def _header(text: str, label: str) -> str:
    return f"{text:60s}{label}"
