"""Quantities: datasheet units at the edge, SI and radians inside.

A channel, a signal or a scenario field carries the symbol of the unit a person reads on a datasheet; every array
inside FTLab is SI (angles in radians). This module is the only place where the two meet.
"""

from __future__ import annotations

import math

STANDARD_GRAVITY = 9.80665
"""m/s^2, the g of "ug" and "mg" on a datasheet."""

_DEGREE = math.pi / 180.0

#: symbol -> (dimension, size of one unit in SI)
_UNITS: dict[str, tuple[str, float]] = {
    "1": ("ratio", 1.0),
    "%": ("ratio", 1e-2),
    "ppm": ("ratio", 1e-6),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "min": ("time", 60.0),
    "m": ("length", 1.0),
    "km": ("length", 1e3),
    "ft": ("length", 0.3048),
    "m/s": ("speed", 1.0),
    "ft/s": ("speed", 0.3048),
    "m/s^2": ("acceleration", 1.0),
    "g": ("acceleration", STANDARD_GRAVITY),
    "mg": ("acceleration", STANDARD_GRAVITY * 1e-3),
    "ug": ("acceleration", STANDARD_GRAVITY * 1e-6),
    "rad": ("angle", 1.0),
    "mrad": ("angle", 1e-3),
    "deg": ("angle", _DEGREE),
    "arcmin": ("angle", _DEGREE / 60.0),
    "arcsec": ("angle", _DEGREE / 3600.0),
    "rad/s": ("angular rate", 1.0),
    "deg/s": ("angular rate", _DEGREE),
    "deg/h": ("angular rate", _DEGREE / 3600.0),
    "deg/sqrt(h)": ("angle random walk", _DEGREE / 60.0),
    "ug/sqrt(Hz)": ("acceleration noise density", STANDARD_GRAVITY * 1e-6),
}


_SI = {kind: symbol for symbol, (kind, size) in _UNITS.items() if size == 1.0} | {
    "angle random walk": "rad/sqrt(s)",
    "acceleration noise density": "m/s^2/sqrt(Hz)",
}


def factor(unit: str) -> float:
    """Size of one ``unit`` in SI.

    Raises:
        ValueError: the unit is not known; the message lists those that are.
    """
    try:
        return _UNITS[unit][1]
    except KeyError:
        raise ValueError(f"unknown unit {unit!r}; known units are {', '.join(sorted(_UNITS))}") from None


def dimension(unit: str) -> str:
    """Physical dimension of a unit, for instance ``"length"``. Raises ValueError for an unknown unit."""
    factor(unit)
    return _UNITS[unit][0]


def si(unit: str) -> str:
    """Symbol of the SI unit of the same dimension: ``"m/s^2"`` for ``"mg"``. Raises ValueError for an unknown unit."""
    return _SI[dimension(unit)]


def compatible(unit: str) -> list[str]:
    """All unit symbols of the same dimension, in the order of the table."""
    wanted = dimension(unit)
    return [symbol for symbol, (kind, _) in _UNITS.items() if kind == wanted]


def to_si(value: float, unit: str) -> float:
    """``value`` given in ``unit``, in SI."""
    return value * factor(unit)


def from_si(value: float, unit: str) -> float:
    """``value`` given in SI, in ``unit``."""
    return value / factor(unit)
