"""Satellites whose pseudoranges are measured: their lines of sight in the scene."""

from typing import Final

from ftcore.description import SceneItem

LINES_OF_SIGHT: Final = SceneItem(
    id="satellite.{satellite}",
    label="{satellite}",
    kind="line-of-sight",
    frame="level",
    family="satellites",
    channel="gps.pseudorange.{satellite}",
    subject="gps.{satellite}",
)
"""One of every member of ``{satellite}``, marked by its health, clicked to fault its pseudorange."""
