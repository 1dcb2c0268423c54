"""Where the satellites of GPS and BD2 stand, for the scene; positions are made from the tables of Yang 2016."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftcore.systems.sins_gps_bd2_cns.forms import Aiding
from ftcore.world import beidou, constellation

Array = NDArray[np.float64]
NAMES = (*(f"gps.{slot}" for slot in constellation.almanac().names), *(f"bd2.{name}" for name in beidou.NAMES))


class Sky:
    """Lines of sight from the aircraft."""

    def __init__(self, aiding: Aiding) -> None:
        self._aiding = aiding

    def lines(self, time: float, lla: Array | None) -> dict[str, Array | None]:
        """Unit vectors (3,) east, north, up to every satellite at ``time`` [s]; None for one that is not in view."""
        if lla is None:
            return dict.fromkeys(NAMES)
        at = self._aiding.constellation_time + time
        positions = np.concatenate([constellation.satellite_states(at)[0], beidou.satellite_positions(at)])
        sight = constellation.line_of_sight(lla, positions)
        visible = sight.visible(self._aiding.mask)
        return {name: sight.unit_n[i] if visible[i] else None for i, name in enumerate(NAMES)}
