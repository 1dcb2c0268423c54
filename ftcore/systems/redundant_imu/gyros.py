"""Three two-axis gyros: their axes, their geometry, and how parity space looks with them."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Block, BlockView, Channel, Health, SceneItem, Subsystem, Wire
from ftcore.detection import ambiguity, geometry, parity
from ftcore.detection.geometry import Cluster
from ftcore.faults import ALL_KINDS
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.instruments import spins_and_planes
from ftcore.parts.ledger import Ledger
from ftcore.systems.redundant_imu.aircraft import AIRCRAFT, HEALTHY
from ftcore.systems.reporting import Now

Array = NDArray[np.float64]

GYRO: Final = "imu.gyro"
AXES: Final = ("1x", "1y", "2x", "2y", "3x", "3y")
INSTRUMENTS: Final = 3
SUBJECTS: Final = tuple(f"{GYRO}.{k}" for k in range(1, INSTRUMENTS + 1))
PAIRS: Final = ("12", "13", "23")
AXES_PICTURE, PARITY_PICTURE = "Gyros", "Parity space"
"""Two spaces of the scene that have nothing but the colours in common."""


def _parity_item(
    id: str, label: str, kind: Literal["plane", "vector", "spin", "ball"], family: str, subject: str | None = None
) -> SceneItem:
    return SceneItem(id=id, label=label, kind=kind, frame="own", picture=PARITY_PICTURE, family=family, subject=subject)


DECLARED: Final = Declared(
    members={
        "gyro": {str(k): f"gyro {k}" for k in range(1, INSTRUMENTS + 1)},
        "axis": {axis: axis for axis in AXES},
        "pair": {pair: f"{pair[0]} or {pair[1]}" for pair in PAIRS},
    },
    # A fault reaches the aircraft with FDI and the one without; the healthy twin's columns come last.
    channels=tuple(
        Channel(
            name=f"{GYRO}.{axis}",
            label=f"Gyro {axis}",
            unit="rad/s",
            sensor=f"{GYRO}.{axis[0]}",
            group=GYRO,
            parts=tuple(len(AXES) * a + i for a in range(AIRCRAFT) if a != HEALTHY),
            kinds=ALL_KINDS,
            typical=0.1,
        )
        for i, axis in enumerate(AXES)
    ),
    subsystems=tuple(Subsystem(name=s, label=f"Gyro {s[-1]}") for s in SUBJECTS),
    subjects={"imu.gyro.{gyro}": "{gyro}"},
    wholes={GYRO: "all gyros"},
    signals=(
        Signals("used.imu.gyro.{gyro}", "{gyro} used", "1", "decision"),
        Signals("geometry.gnc", "J_GNC: navigation index, small is good", "1", "geometry"),
        Signals("geometry.fdi", "J_FDI: isolation index, 4 is best", "1", "geometry"),
    ),
    blocks=(
        *(
            Block(
                id=f"gyro-{k}", label=f"Gyro {k}", kind="sensor", x=1, y=2 + 13 * (k - 1), width=21, height=11,
                sensor=f"{GYRO}.{k}", subsystem=f"{GYRO}.{k}",
            )
            for k in (1, 2, 3)
        ),
        Block(id="geometry", label="Geometry", kind="computer", x=1, y=55, width=21, height=11),
    ),
    wires=tuple(Wire(source=f"gyro-{k}", target="detection") for k in (1, 2, 3)),
    # A family's colour follows from its place among all: gyros and paths have those of their lines in the charts.
    scene=(
        *(
            SceneItem(
                id=f"axis.{axis}", label=axis, kind="axis", picture=AXES_PICTURE, family=f"gyro {axis[0]}",
                channel=f"{GYRO}.{axis}", subject=f"{GYRO}.{axis[0]}",
            )
            for axis in AXES
        ),
        *(
            item
            for k in (1, 2, 3)
            for item in (
                SceneItem(id=f"spin.{k}", label=f"spin {k}", kind="spin", picture=AXES_PICTURE, family=f"gyro {k}"),
                _parity_item(f"plane.{k}", f"fault plane {k}", "plane", f"gyro {k}", f"{GYRO}.{k}"),
            )
        ),
        _parity_item("parity", "parity vector", "vector", "parity vector"),
        _parity_item("singular.{pair}", "{pair}", "spin", "singular directions"),
        SceneItem(
            id="aircraft", label="aircraft", kind="aircraft", frame="level", picture=AXES_PICTURE, family="aircraft"
        ),
        _parity_item("threshold", "threshold", "ball", "detection threshold"),
    ),
)  # fmt: skip


class Geometry:
    """What follows from how the gyros are mounted.

    Args:
        cluster: their axes and parity space.
        noise: of every axis [rad/s].
    """

    def __init__(self, cluster: Cluster, noise: float) -> None:
        self._gnc, self._fdi = float(geometry.gnc_index(cluster.H)), float(geometry.fdi_index(cluster.H))
        self._expected = parity.uncalibrated(cluster, noise, 0.0)
        self._shares: dict[float, float] = {}
        lines = {found.instruments: found.line for found in geometry.singular_faults(cluster)}
        nowhere = np.full(3, np.nan)
        self.vectors: dict[str, Array] = {
            **{f"axis.{axis}": cluster.H[i] for i, axis in enumerate(AXES)},
            **spins_and_planes(cluster),
            "singular.{pair}": np.array([0.7 * lines.get((int(a) - 1, int(b) - 1), nowhere) for a, b in PAIRS]),
            # The parity vector is drawn in units of its threshold: detection is leaving this ball.
            "threshold": np.array([0.0, 0.0, 1.0]),
        }
        """Scene item -> its vector, the same all the time."""

    def report(self, say: Ledger) -> None:
        """The indices of the mounting."""
        say["geometry.gnc"], say["geometry.fdi"] = [self._gnc], [self._fdi]

    def ambiguous_share(self, degrees: float) -> float:
        """Share of all directions of a fault that the angle test cannot place, at this threshold of the angle [deg]."""
        if degrees not in self._shares:
            self._shares[degrees] = float(ambiguity.ambiguity_map(self._expected, math.radians(degrees))[2].mean())
        return self._shares[degrees]

    def blocks(self, now: Now) -> dict[str, BlockView]:
        """The diagram's blocks of gyros and geometry."""
        found = {"geometry": BlockView(health="ok", text=f"J_FDI {self._fdi:.2f}, J_GNC {self._gnc:.3f}")}
        used = [True] * INSTRUMENTS if now.said is None else now.said["used.imu.gyro.{gyro}"][0] > 0.0
        for k, subject in enumerate(SUBJECTS):
            thought = now.health[subject]
            broken = any(channel.startswith(subject) for channel in now.faulted)
            in_doubt = "in doubt" if now.said is not None and used[k] else "withheld"
            words = {"ok": "used", "suspect": in_doubt, "isolated": "isolated", "off": "off"}
            health: Health = "faulted" if broken and thought != "off" else thought
            found[f"gyro-{k + 1}"] = BlockView(health=health, text=words[thought] + (", fault" if broken else ""))
        return found
