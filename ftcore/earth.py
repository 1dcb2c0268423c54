"""WGS-84 Earth: figure, rotation, normal gravity and the frames tied to them.

Foundation floor: both truth (``ftcore.world``) and a navigator (``ftcore.estimation``) carry this model, so it imports
nothing of either.

Conventions, held by every navigation module of the core:

- SI units and radians. Navigation frame n: local level, x east, y north, z up (ENU). Earth frame e: ECEF. Body frame b:
  forward-right-down.
- ``v_n`` is a vector resolved in frame n; ``C_nb`` turns a vector from b into n.
- A geodetic position ``lla`` is (..., 3): latitude [rad], longitude [rad], height above the ellipsoid [m].
- Every function broadcasts over arbitrary leading axes; none changes its input.

Sources: NIMA TR8350.2 (WGS-84), 3rd edition; Groves, "Principles of GNSS, Inertial, and Multisensor Integrated
Navigation Systems", 2nd edition, ch. 2.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

SPEED_OF_LIGHT: Final = 299_792_458.0
"""Speed of light in vacuum [m/s]."""
RATE: Final = 7.292115e-5
"""Rotation rate of the Earth [rad/s]."""
GM: Final = 3.986004418e14
"""Gravitational constant of the Earth with its atmosphere [m^3/s^2]."""
A: Final = 6_378_137.0
"""Equatorial radius of the ellipsoid [m]."""
F: Final = 1.0 / 298.257223563
"""Flattening of the ellipsoid."""
B: Final = A * (1.0 - F)
"""Polar radius of the ellipsoid [m]."""
E2: Final = F * (2.0 - F)
"""First eccentricity squared."""
GRAVITY_EQUATOR: Final = 9.7803253359
"""Normal gravity on the ellipsoid at the equator [m/s^2]."""
GRAVITY_POLE: Final = 9.8321849378
"""Normal gravity on the ellipsoid at the poles [m/s^2]."""
SOMIGLIANA: Final = B * GRAVITY_POLE / (A * GRAVITY_EQUATOR) - 1.0
"""Constant k of Somigliana's formula."""
STANDARD_GRAVITY: Final = 9.80665
"""The g of datasheets [m/s^2]; never the local gravity."""

# m = rate^2 a^2 b / GM: ratio of centrifugal to gravitational acceleration at the equator.
_M: Final = RATE**2 * A**2 * B / GM
GRAVITY_SLOPE: Final = 1.0 + F + _M
"""Relative decrease of gravity with height at the equator, in units of 2 height / A."""


def principal_radii(lat: ArrayLike) -> tuple[Array, Array]:
    """Radii of curvature of the ellipsoid in the meridian and in the prime vertical.

    ``lat``: (...) rad. Returns ``(R_M, R_N)``, each (...) m; height is not included. Source: Groves (2.105), (2.106).
    """
    w2 = 1.0 - E2 * np.square(np.sin(lat))
    r_n = A / np.sqrt(w2)
    return r_n * ((1.0 - E2) / w2), r_n


def gravity(lat: ArrayLike, height: ArrayLike) -> Array:
    """Magnitude of normal gravity (attraction and centrifugal), pointing down.

    ``lat``: (...) rad, ``height``: (...) m. Returns (...) m/s^2. Source: NIMA TR8350.2 (4-1) and (4-3), good to 1e-6 of
    gravity below 20 km.
    """
    s2 = np.square(np.sin(lat))
    x = np.asarray(height, dtype=np.float64) * (1.0 / A)
    surface = GRAVITY_EQUATOR * (1.0 + SOMIGLIANA * s2) / np.sqrt(1.0 - E2 * s2)
    return np.asarray(surface * (1.0 + x * (3.0 * x - 2.0 * (GRAVITY_SLOPE - 2.0 * F * s2))))


def gravity_gradient(lat: ArrayLike, height: ArrayLike) -> tuple[Array, Array]:
    """Derivatives of :func:`gravity`: ``(dg/dlat [m/s^2/rad], dg/dheight [1/s^2])``, each (...).

    The height terms of dg/dlat are left out: at 20 km they are 0.6 % of it, and it is itself a small term.
    """
    s2 = np.square(np.sin(lat))
    w2 = 1.0 - E2 * s2
    surface = GRAVITY_EQUATOR * (1.0 + SOMIGLIANA * s2) / np.sqrt(w2)
    d_lat = np.sin(2.0 * np.asarray(lat)) * (GRAVITY_EQUATOR * SOMIGLIANA / np.sqrt(w2) + 0.5 * E2 * surface / w2)
    x = np.asarray(height, dtype=np.float64) * (1.0 / A)
    d_height = surface * (6.0 * x - 2.0 * (GRAVITY_SLOPE - 2.0 * F * s2)) * (1.0 / A)
    return np.asarray(d_lat), np.asarray(d_height)


def earth_rate_n(lat: ArrayLike) -> Array:
    """Rotation rate of the Earth resolved in n: (..., 3) rad/s from ``lat`` (...) rad."""
    lat = np.asarray(lat, dtype=np.float64)
    rate = np.zeros((*lat.shape, 3))
    rate[..., 1] = RATE * np.cos(lat)
    rate[..., 2] = RATE * np.sin(lat)
    return rate


def transport_rate_n(lat: ArrayLike, height: ArrayLike, v_n: Array) -> Array:
    """Rotation rate of n over the Earth, because the level turns with the vehicle, resolved in n.

    ``lat`` (...) rad, ``height`` (...) m, ``v_n`` (..., 3) m/s. Returns (..., 3) rad/s. Source: Groves (5.44), in ENU.
    """
    r_m, r_n = principal_radii(lat)
    height = np.asarray(height, dtype=np.float64)
    north = v_n[..., 0] / (r_n + height)
    east = -v_n[..., 1] / (r_m + height)
    up = north * np.tan(lat)
    return np.stack(np.broadcast_arrays(east, north, up), axis=-1)


def geodetic_to_ecef(lla: Array) -> Array:
    """Earth-fixed position (..., 3) m of a geodetic position ``lla`` (..., 3). Source: Groves (2.112)."""
    lla = np.asarray(lla, dtype=np.float64)
    lat, lon, height = lla[..., 0], lla[..., 1], lla[..., 2]
    sin_lat, cos_lat = np.sin(lat), np.cos(lat)
    r_n = A / np.sqrt(1.0 - E2 * sin_lat * sin_lat)
    across = (r_n + height) * cos_lat
    return np.stack([across * np.cos(lon), across * np.sin(lon), ((1.0 - E2) * r_n + height) * sin_lat], axis=-1)


def ecef_to_geodetic(position_e: Array) -> Array:
    """Geodetic position (..., 3) of an Earth-fixed position (..., 3) m.

    Bowring's formula, repeated: within 1e-8 m from the Earth's surface to satellite height, poles included. Deeper than
    1000 km below the surface the result is meaningless.
    Source: Bowring (1976), "Transformation from spatial to geographical coordinates".
    """
    p = np.asarray(position_e, dtype=np.float64)
    x, y, z = p[..., 0], p[..., 1], p[..., 2]
    across = np.hypot(x, y)
    second_e2 = E2 / (1.0 - E2)
    # Bowring works with the parametric latitude beta; one pass is good near the surface, three also in orbit.
    beta = np.arctan2(A * z, B * across)
    lat = beta
    for _ in range(3):
        lat = np.arctan2(z + second_e2 * B * np.sin(beta) ** 3, across - E2 * A * np.cos(beta) ** 3)
        beta = np.arctan2((1.0 - F) * np.sin(lat), np.cos(lat))
    sin_lat, cos_lat = np.sin(lat), np.cos(lat)
    # This form of the height has no division by cos(lat), hence no pole.
    height = across * cos_lat + z * sin_lat - A * np.sqrt(1.0 - E2 * sin_lat * sin_lat)
    return np.stack([lat, np.arctan2(y, x), height], axis=-1)


def enu_to_ecef_matrix(lat: ArrayLike, lon: ArrayLike) -> Array:
    """Matrix ``C_en`` (..., 3, 3) that turns ENU vectors into ECEF, from latitude and longitude (...) rad."""
    lat, lon = np.broadcast_arrays(np.asarray(lat, dtype=np.float64), np.asarray(lon, dtype=np.float64))
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    C_en = np.zeros((*lat.shape, 3, 3))
    C_en[..., 0, 0] = -sin_lon
    C_en[..., 1, 0] = cos_lon
    C_en[..., 0, 1] = -sin_lat * cos_lon
    C_en[..., 1, 1] = -sin_lat * sin_lon
    C_en[..., 2, 1] = cos_lat
    C_en[..., 0, 2] = cos_lat * cos_lon
    C_en[..., 1, 2] = cos_lat * sin_lon
    C_en[..., 2, 2] = sin_lat
    return C_en
