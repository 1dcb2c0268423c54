"""Where the satellites of GPS and BD2 stand, and the star tracker's boresight, for the scene; positions are made from
the tables of Yang 2016."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Health, SceneItem
from ftcore.parts.declared import Declared
from ftcore.parts.ledger import Ledger
from ftcore.parts.navigation import Truth
from ftcore.systems.reporting import Now
from ftcore.systems.sins_gps_bd2_cns.forms import Aiding
from ftcore.world import beidou, constellation

Array = NDArray[np.float64]
NAMES = (*(f"gps.{slot}" for slot in constellation.almanac().names), *(f"bd2.{name}" for name in beidou.NAMES))


DECLARED: Final = Declared(
    scene=(
        SceneItem(id="boresight", label="CNS", kind="vector", family="star tracker", channel="cns.attitude.heading"),
        *(
            SceneItem(
                id=f"satellite.{name}",
                label=name.split(".")[1],
                kind="line-of-sight",
                frame="level",
                family=f"{name[:3].upper()} satellites",
                channel=f"{name[:3]}.position.all",
                subject=name[:3],
            )
            for name in NAMES
        ),
    ),
)
LINE: Final = 1.5
"""Length of a line of sight in the scene."""
VECTORS: Final = {"boresight": np.array([0.0, 0.0, -1.2])}
"""Scene items that never change."""


class Sky:
    """Lines of sight from the aircraft."""

    def __init__(self, aiding: Aiding) -> None:
        self._aiding = aiding

    def draw(self, time: float, truth: Truth, say: Ledger) -> None:
        """Draw the lines of sight to the satellites in view at ``time`` [s]."""
        at = self._aiding.constellation_time + time
        positions = np.concatenate([constellation.satellite_states(at)[0], beidou.satellite_positions(at)])
        sight = constellation.line_of_sight(truth.lla[0], positions)
        lines = np.where(sight.visible(self._aiding.mask)[:, None], LINE * sight.unit_n, np.nan)
        for name, line in zip(NAMES, lines, strict=True):
            say.draw(f"satellite.{name}", line)


def items(now: Now) -> dict[str, Health]:
    """A satellite system and the star tracker are marked by what becomes of the aid; a mere suspicion marks nothing."""
    marks: dict[str, Health] = {}
    for aid in ("gps", "bd2", "cns"):
        broken = any(channel.startswith(aid + ".") for channel in now.faulted)
        thought = now.health[aid]
        marks[aid] = "faulted" if broken else "ok" if thought == "suspect" else thought
    return {"boresight": marks["cns"]} | {f"satellite.{name}": marks[name[:3]] for name in NAMES}
