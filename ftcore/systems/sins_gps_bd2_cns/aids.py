"""GPS, BD2 and the star tracker: their channels, and whether each is used."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Channel, Subsystem
from ftcore.faults import ALL_KINDS
from ftcore.parts.declared import Declared, Signals, channels_of
from ftcore.parts.ledger import Ledger
from ftcore.systems.base import Flags

AIDS: Final = {"gps": "GPS", "bd2": "BD2", "cns": "CNS"}
_ENU, _RPY = ("east", "north", "up"), ("roll", "pitch", "heading")
_READ: Final = {
    "gps": ("position", "m", _ENU, "all axes", 12.0),
    "bd2": ("position", "m", _ENU, "all axes", 12.0),
    "cns": ("attitude", "arcsec", _RPY, "all angles", 20.0),
}
"""Aid -> quantity, unit, parts, what all of them are called, fault worth trying first."""
READINGS: Final = {aid: f"{aid}.{quantity}" for aid, (quantity, *_) in _READ.items()}
"""Aid -> reading group."""


def _channels(aid: str) -> tuple[Channel, ...]:
    quantity, unit, parts, everything, typical = _READ[aid]
    label, names = AIDS[aid], {part: part for part in parts}
    return (
        *channels_of(READINGS[aid], f"{label} {{}}", names, sensor=aid, unit=unit, kinds=ALL_KINDS, typical=typical),
        Channel(
            name=f"{READINGS[aid]}.all",
            label=f"{label} {quantity}, {everything}",
            unit=unit,
            sensor=aid,
            group=READINGS[aid],
            parts=(0, 1, 2),
            kinds=ALL_KINDS,
            typical=typical,
        ),
    )


DECLARED: Final = Declared(
    members={"aid": AIDS},
    channels=tuple(channel for aid in AIDS for channel in _channels(aid)),
    subsystems=tuple(Subsystem(name=name, label=label) for name, label in AIDS.items()),
    subjects={"{aid}": "{aid}"},
    signals=(Signals("used.{aid}", "{aid} used", "1", "decision"),),
)


def report(say: Ledger, health: NDArray[np.int8], used: Flags) -> None:
    """The decision on the three aids, ``(runs, 3)`` each."""
    say.judge("{aid}", health, used)
    say["used.{aid}"] = used
