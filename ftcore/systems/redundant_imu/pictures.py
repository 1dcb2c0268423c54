"""Diagram and 3-D scene of the redundant-IMU system."""

from __future__ import annotations

from ftcore.description import Block, SceneItem, Wire
from ftcore.systems.redundant_imu.names import AIR, AXES, FLOWN_LABELS, GYRO


def blocks() -> list[Block]:
    """The blocks and where they stand, after the paper's figure 4."""
    test = ("driving_test", "false_alarm_probability", "angle_threshold")
    gyros = [
        Block(
            id=f"gyro-{k}", label=f"Gyro {k}", kind="sensor", x=1, y=2 + 13 * (k - 1), width=21, height=11,
            sensor=f"{GYRO}.{k}", subsystem=f"{GYRO}.{k}",
        )
        for k in (1, 2, 3)
    ]  # fmt: skip
    return [
        *gyros,
        Block(id="air", label="Air data", kind="sensor", x=1, y=41, width=21, height=11, sensor=AIR, subsystem=AIR),
        Block(id="geometry", label="Geometry", kind="computer", x=1, y=55, width=21, height=11),
        Block(id="detection", label="Detection", kind="test", x=26, y=2, width=23, height=12, settings=test),
        Block(id="isolation", label="Isolation", kind="test", x=26, y=19, width=23, height=12, settings=test),
        Block(id="ukf", label="UKF", kind="filter", x=26, y=41, width=23, height=12, settings=("hybrid", "lead")),
        Block(
            id="supervisor", label="Supervisor", kind="supervisor", x=52, y=19, width=23, height=14,
            settings=("confirm", "within", "hold_off"),
        ),
        Block(id="control", label="LQR control", kind="master", x=78, y=19, width=21, height=14),
        Block(id="mission", label="F-16", kind="computer", x=78, y=48, width=21, height=14),
    ]  # fmt: skip


def wires() -> list[Wire]:
    """What feeds what. The aircraft's motion closes the loop through the sensors."""
    pairs: list[tuple[str, str, str | None]] = [
        *((f"gyro-{k}", "detection", None) for k in (1, 2, 3)),
        *((f"gyro-{k}", "control", f"{GYRO}.{k}") for k in (1, 2, 3)),
        ("detection", "isolation", None),
        ("isolation", "ukf", None),
        ("isolation", "supervisor", None),
        ("air", "ukf", AIR),
        ("ukf", "supervisor", None),
        ("supervisor", "control", None),
        ("control", "mission", None),
    ]
    return [Wire(source=a, target=b, carries=c) for a, b, c in pairs]


INSTRUMENTS, PARITY, PATHS = "Gyros", "Parity space", "Flight paths"
"""Pictures of the scene: three spaces that have nothing but the colours in common."""
KILOMETRE = 1000.0
"""Metres to a unit of the scene, for flight paths."""


def scene() -> list[SceneItem]:
    """What the scene shows: axes at their mounting angles; parity space with its planes; three flight paths.

    A family's colour follows from its place among all: gyros and paths have those of their lines in the charts.
    """
    items = [
        SceneItem(
            id=f"axis.{axis}",
            label=axis,
            kind="axis",
            picture=INSTRUMENTS,
            family=f"gyro {axis[0]}",
            channel=f"{GYRO}.{axis}",
        )
        for axis in AXES
    ]
    for k in (1, 2, 3):
        items.append(SceneItem(id=f"spin.{k}", label=f"spin {k}", kind="spin", picture=INSTRUMENTS, family=f"gyro {k}"))
        items.append(
            SceneItem(
                id=f"plane.{k}",
                label=f"fault plane {k}",
                kind="plane",
                frame="own",
                picture=PARITY,
                family=f"gyro {k}",
            )
        )
    items.append(
        SceneItem(
            id="parity", label="parity vector", kind="vector", frame="own", picture=PARITY, family="parity vector"
        )
    )
    for pair in ("12", "13", "23"):
        items.append(
            SceneItem(
                id=f"singular.{pair}",
                label=f"{pair[0]} or {pair[1]}",
                kind="spin",
                frame="own",
                picture=PARITY,
                family="singular directions",
            )
        )
    items.append(
        SceneItem(
            id="aircraft", label="aircraft", kind="aircraft", frame="level", picture=INSTRUMENTS, family="aircraft"
        )
    )
    for name in ("protected", "healthy", "unprotected"):
        items.append(
            SceneItem(
                id=f"path.{name}",
                label=FLOWN_LABELS[name],
                kind="path",
                frame="level",
                picture=PATHS,
                family=FLOWN_LABELS[name],
                trail=(f"path.{name}.east", f"path.{name}.north", f"path.{name}.up"),
                unit_length=KILOMETRE,
            )
        )
    items.append(
        SceneItem(
            id="threshold", label="threshold", kind="ball", frame="own", picture=PARITY, family="detection threshold"
        )
    )
    return items
