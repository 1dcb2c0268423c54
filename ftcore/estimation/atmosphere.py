"""What the atmosphere adds to a pseudorange, as a single-frequency receiver corrects it.

Conventions of :mod:`ftcore.earth`: radians and metres inside. Everything broadcasts.
Sources: IS-GPS-200, 20.3.3.5.2.5 and figure 20-4 (J.A. Klobuchar, IEEE Trans. AES-23, 1987); J. Saastamoinen, Bulletin
Geodesique 105-107 (1972-73), with the standard atmosphere.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftcore import earth

Array = NDArray[np.float64]

_DAY: Final = 86400.0
_NIGHT: Final = 5e-9
"""Delay of the ionosphere at night, at the zenith [s]."""
_NOON: Final = 50400.0
"""Local time of the greatest delay [s]."""


def klobuchar(
    lat: ArrayLike, lon: ArrayLike, elevation: Array, azimuth: Array, gps_seconds: float | Array, coefficients: Array
) -> Array:
    """Delay of an L1 signal in the ionosphere [m].

    Args:
        lat, lon: receiver [rad], broadcasting to the shape of ``elevation``.
        elevation, azimuth: of the satellite [rad].
        gps_seconds: time, seconds of the GPS week (or of any day).
        coefficients: (8,) alpha 0-3 and beta 0-3 of the navigation message [s per semicircle^k].
    """
    alpha, beta = coefficients[:4], coefficients[4:]
    # The model's angles are semicircles.
    el, lat_u, lon_u = elevation / math.pi, np.asarray(lat) / math.pi, np.asarray(lon) / math.pi
    psi = 0.0137 / (el + 0.11) - 0.022
    lat_i = np.clip(lat_u + psi * np.cos(azimuth), -0.416, 0.416)
    lon_i = lon_u + psi * np.sin(azimuth) / np.cos(lat_i * math.pi)
    lat_m = lat_i + 0.064 * np.cos((lon_i - 1.617) * math.pi)
    local = np.mod(4.32e4 * lon_i + gps_seconds, _DAY)
    period = np.maximum(np.polynomial.polynomial.polyval(lat_m, beta), 72000.0)
    amplitude = np.maximum(np.polynomial.polynomial.polyval(lat_m, alpha), 0.0)
    x = 2.0 * math.pi * (local - _NOON) / period
    day = np.where(np.abs(x) < 1.57, amplitude * (1.0 - x**2 / 2.0 + x**4 / 24.0), 0.0)
    slant = 1.0 + 16.0 * (0.53 - el) ** 3
    return np.asarray(earth.SPEED_OF_LIGHT * slant * (_NIGHT + day))


def saastamoinen(lat: ArrayLike, height: ArrayLike, elevation: Array, humidity: float = 0.7) -> Array:
    """Delay in the troposphere [m] by the standard atmosphere; 0 below the horizon and above 10 km.

    Args:
        lat: receiver [rad].
        height: receiver, above sea level or the ellipsoid [m].
        elevation: of the satellite [rad].
        humidity: relative, at the ground.
    """
    h = np.clip(np.asarray(height, dtype=np.float64), 0.0, 1e4)
    pressure = 1013.25 * (1.0 - 2.2557e-5 * h) ** 5.2568
    temperature = 15.0 - 6.5e-3 * h + 273.16
    vapour = 6.108 * humidity * np.exp((17.15 * temperature - 4684.0) / (temperature - 38.45))
    slant = 1.0 / np.sin(np.maximum(elevation, math.radians(1.0)))
    dry = 0.0022768 * pressure / (1.0 - 0.00266 * np.cos(2.0 * np.asarray(lat)) - 0.00028 * h / 1e3)
    wet = 0.002277 * (1255.0 / temperature + 0.05) * vapour
    outside = (np.asarray(elevation) <= 0.0) | (np.asarray(height) > 1e4)
    return np.where(outside, 0.0, (dry + wet) * slant)
