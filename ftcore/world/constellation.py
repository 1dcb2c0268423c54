"""The nominal 24-slot GPS constellation: circular orbits, and how a user on the Earth sees them.

Conventions of :mod:`ftcore.earth`. Positions are Earth-fixed; light time and satellite clocks are left to the receiver
model. Source of the slots and of the epoch: Global Positioning System Standard Positioning Service Performance
Standard, table of the nominal (24-slot) constellation; kept in ``gps_24_slots.csv`` beside this file.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftcore import earth

Array = NDArray[np.float64]

SEMI_MAJOR_AXIS: Final = 26_559_700.0
"""Radius of the circular orbits [m]."""
INCLINATION: Final = math.radians(55.0)
"""Inclination of the orbits [rad]."""
EPOCH_SIDEREAL_ANGLE: Final = math.radians(15.0 * (18.0 + 36.0 / 60.0 + 14.4 / 3600.0))
"""Greenwich mean sidereal time at the almanac epoch, 1993-07-01 00:00:00 [rad]."""
MEAN_MOTION: Final = math.sqrt(earth.GM / SEMI_MAJOR_AXIS**3)
"""Angular rate of a satellite along its orbit [rad/s]; half a sidereal day a turn."""


@dataclass(frozen=True, slots=True)
class Almanac:
    """Slots of the constellation at the epoch.

    ``names``: slot letters and numbers; ``node`` (24,): longitude of the ascending node *relative to Greenwich* [rad];
    ``argument`` (24,): argument of latitude [rad].
    """

    names: tuple[str, ...]
    node: Array
    argument: Array


@cache
def almanac() -> Almanac:
    """The 24 slots, read once."""
    text = (resources.files("ftcore.world") / "gps_24_slots.csv").read_text("utf-8")
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    node = np.radians([float(row["raan_deg"]) for row in rows]) - EPOCH_SIDEREAL_ANGLE
    argument = np.radians([float(row["argument_of_latitude_deg"]) for row in rows])
    node.setflags(write=False)
    argument.setflags(write=False)
    return Almanac(tuple(row["slot"] for row in rows), node, argument)


def satellite_states(time: ArrayLike) -> tuple[Array, Array]:
    """Earth-fixed position and velocity of all satellites.

    ``time`` (...) seconds since the almanac epoch. Returns ``(position_e [m], velocity_e [m/s])``, each (..., 24, 3),
    in the order of :func:`almanac`. The velocity is relative to the turning Earth.
    """
    slots = almanac()
    t = np.asarray(time, dtype=np.float64)[..., None]
    u = slots.argument + MEAN_MOTION * t
    node = slots.node - earth.RATE * t
    cos_u, sin_u, cos_node, sin_node = np.cos(u), np.sin(u), np.cos(node), np.sin(node)
    # In the orbital plane, from the node: along it, and across it as the equator and the axis see it.
    across, up = sin_u * math.cos(INCLINATION), sin_u * math.sin(INCLINATION)
    d_across, d_up = cos_u * math.cos(INCLINATION), cos_u * math.sin(INCLINATION)
    position = np.stack([cos_u * cos_node - across * sin_node, cos_u * sin_node + across * cos_node, up], axis=-1)
    along = np.stack([-sin_u * cos_node - d_across * sin_node, -sin_u * sin_node + d_across * cos_node, d_up], axis=-1)
    position *= SEMI_MAJOR_AXIS
    velocity = along * (SEMI_MAJOR_AXIS * MEAN_MOTION)
    velocity[..., 0] += earth.RATE * position[..., 1]
    velocity[..., 1] -= earth.RATE * position[..., 0]
    return position, velocity


@dataclass(frozen=True, slots=True)
class LineOfSight:
    """How a user sees satellites, all (..., satellites): ``unit_n`` (..., satellites, 3) from user to satellite, ENU.

    ``range`` m; ``elevation`` rad above the horizon; ``azimuth`` rad clockwise from north, in [0, 2 pi).
    """

    unit_n: Array
    range: Array
    elevation: Array
    azimuth: Array

    def visible(self, mask_deg: float = 5.0) -> NDArray[np.bool_]:
        """Which satellites stand above an elevation mask in degrees."""
        return np.asarray(self.elevation > math.radians(mask_deg))


def line_of_sight(lla: Array, satellite_e: Array) -> LineOfSight:
    """Directions and ranges from a user at ``lla`` (..., 3) to satellites at ``satellite_e`` (..., satellites, 3) m."""
    lla = np.asarray(lla, dtype=np.float64)
    return seen_from(earth.geodetic_to_ecef(lla), earth.enu_to_ecef_matrix(lla[..., 0], lla[..., 1]), satellite_e)


def seen_from(position_e: Array, C_en: Array, satellite_e: Array) -> LineOfSight:
    """The same from a user at ``position_e`` (..., 3) m, whose local level ``C_en`` (..., 3, 3) is known already."""
    to_satellite_n = (satellite_e - position_e[..., None, :]) @ C_en
    distance = np.sqrt(np.einsum("...i,...i->...", to_satellite_n, to_satellite_n))
    unit_n = to_satellite_n / distance[..., None]
    elevation = np.arctan2(unit_n[..., 2], np.hypot(unit_n[..., 0], unit_n[..., 1]))
    azimuth = np.mod(np.arctan2(unit_n[..., 0], unit_n[..., 1]), 2.0 * np.pi)
    return LineOfSight(unit_n, distance, elevation, azimuth)


def visible(lla: Array, satellite_e: Array, mask_deg: float = 5.0) -> NDArray[np.bool_]:
    """Which satellites (..., satellites) a user sees above an elevation mask in degrees; shapes as in line_of_sight."""
    return line_of_sight(lla, satellite_e).visible(mask_deg)


LOOKS = 60.0
"""Seconds between two looks at a satellite that is watched for hours."""
BETWEEN = math.radians(1.0)
"""More than what a satellite rises by in half that time, and a user's horizon tilts at up to 1000 m/s [rad]."""


def may_be_visible(slot: int, lla: Array, time: Array, mask_deg: float, away: ArrayLike = 0.0) -> bool:
    """Whether a satellite may stand above the mask somewhere on the way; False only where it does not for certain.

    ``slot`` in the order of :func:`almanac`; ``lla`` (3,) where the user is, or was, and how far ``away`` from there
    [m] it may be by now; ``time`` (n,) seconds since the almanac epoch, at most :data:`LOOKS` apart.
    """
    position, _ = satellite_states(time)
    sight = line_of_sight(lla, position)
    # The horizon tilts by the arc that is travelled, and the direction turns by less than half of that.
    tilt = 1.5 * np.asarray(away) / earth.A
    return bool((sight.elevation[..., slot] > math.radians(mask_deg) - BETWEEN - tilt).any())
