"""The nominal BeiDou-2 (BD2) regional constellation of 2012: five geostationary, five inclined, four medium orbits.

Circular orbits, Earth-fixed positions in the conventions of :mod:`ftcore.earth`; good to show where they stand, not for
navigation. The sidereal angle is that of :mod:`ftcore.world.constellation` at its epoch. Source: BeiDou Navigation
Satellite System Signal In Space Interface Control Document, Open Service Signal (Version 2.0), 2013, section 3.1:
geostationary at 58.75, 80, 110.5, 140 and 160 degrees east; inclined geosynchronous at 55 degrees, three crossing the
equator at 118 and two at 95 degrees east, one of each track a third of a turn after the other; medium orbits of
27 906.1 km and 55 degrees, slots 7 and 8 of the first and 3 and 4 of the second of the Walker 24/3/1 planes. The node
of the first medium plane is set to zero here, as the document leaves it open.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore import earth

Array = NDArray[np.float64]

GEO_LONGITUDES: Final = (58.75, 80.0, 110.5, 140.0, 160.0)
"""Longitudes of the geostationary satellites [deg east]."""
IGSO: Final = ((118.0, 0.0), (118.0, 120.0), (118.0, 240.0), (95.0, 0.0), (95.0, 120.0))
"""Inclined geosynchronous: longitude of the ascending crossing [deg east], argument of latitude at the epoch [deg]."""
MEO: Final = ((0.0, 270.0), (0.0, 315.0), (120.0, 105.0), (120.0, 150.0))
"""Medium orbits: node [deg], argument of latitude at the epoch [deg]."""
INCLINATION: Final = math.radians(55.0)
"""Of the inclined and the medium orbits [rad]."""
GEOSYNCHRONOUS: Final = (earth.GM / earth.RATE**2) ** (1.0 / 3.0)
"""Radius of an orbit that turns with the Earth [m]."""
MEO_RADIUS: Final = 27_906_100.0
"""Radius of the medium orbits [m]."""
NAMES: Final = (
    *(f"G{i}" for i in range(1, 1 + len(GEO_LONGITUDES))),
    *(f"I{i}" for i in range(1, 1 + len(IGSO))),
    *(f"M{i}" for i in range(1, 1 + len(MEO))),
)
"""G geostationary, I inclined geosynchronous, M medium orbit."""


def satellite_positions(time: float) -> Array:
    """Earth-fixed positions ``(14, 3)`` [m], in the order of :data:`NAMES`, ``time`` seconds after the epoch."""
    longitude = np.radians(GEO_LONGITUDES)
    geo = GEOSYNCHRONOUS * np.stack([np.cos(longitude), np.sin(longitude), np.zeros(len(longitude))], axis=-1)
    crossing, start = np.radians(IGSO).T
    # The node stands still among the stars: at `crossing` when the satellite passes it, `start` before or after.
    argument = start + earth.RATE * time
    igso = _circular(GEOSYNCHRONOUS, crossing - argument, argument)
    node, start = np.radians(MEO).T
    rate = math.sqrt(earth.GM / MEO_RADIUS**3)
    meo = _circular(MEO_RADIUS, node - earth.RATE * time, start + rate * time)
    return np.concatenate([geo, igso, meo])


def _circular(radius: float, node: Array, argument: Array) -> Array:
    """Earth-fixed positions on circular orbits of inclination 55 deg: ``node`` counted from Greenwich [rad]."""
    cos_u, sin_u, cos_n, sin_n = np.cos(argument), np.sin(argument), np.cos(node), np.sin(node)
    across = sin_u * math.cos(INCLINATION)
    x, y = cos_u * cos_n - across * sin_n, cos_u * sin_n + across * cos_n
    return radius * np.stack([x, y, sin_u * math.sin(INCLINATION)], axis=-1)
