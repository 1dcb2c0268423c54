"""Diagram and 3-D scene of the SINS/GPS/BD2/CNS system."""

from __future__ import annotations

from ftcore.description import Block, SceneItem, Wire
from ftcore.systems.sins_gps_bd2_cns.names import AXES, BODY, CLUSTERS
from ftcore.systems.sins_gps_bd2_cns.sky import NAMES


def blocks() -> list[Block]:
    """The blocks and where they stand."""
    bounds = ("driving_test", "false_alarm_probability", "doubt_probability")
    return [
        Block(id="gyro", label="Gyros", kind="sensor", x=1, y=2, width=21, height=11, sensor="imu.gyro"),
        Block(
            id="accelerometer", label="Accels", kind="sensor", x=1, y=15, width=21, height=11,
            sensor="imu.accelerometer",
        ),
        Block(id="gps", label="GPS", kind="sensor", x=1, y=29, width=21, height=11, sensor="gps", subsystem="gps"),
        Block(id="bd2", label="BD2", kind="sensor", x=1, y=42, width=21, height=11, sensor="bd2", subsystem="bd2"),
        Block(id="cns", label="CNS", kind="sensor", x=1, y=55, width=21, height=11, sensor="cns", subsystem="cns"),
        Block(
            id="sins", label="SINS", kind="computer", x=26, y=8, width=20, height=12,
            settings=("feedback_period", "imu_driving_test"),
        ),
        Block(
            id="models", label="IMM predict", kind="filter", x=50, y=2, width=22, height=11, settings=("mode_driver",)
        ),
        Block(
            id="propagators", label="Propagators", kind="computer", x=50, y=15, width=26, height=11,
            settings=("propagator_period", "propagator_models"),
        ),
        Block(id="filter-gps", label="GPS test", kind="test", x=27, y=29, width=26, height=11, settings=bounds),
        Block(id="filter-bd2", label="BD2 test", kind="test", x=27, y=42, width=26, height=11, settings=bounds),
        Block(id="filter-cns", label="CNS test", kind="test", x=27, y=55, width=26, height=11, settings=bounds),
        Block(
            id="supervisor", label="Supervisor", kind="supervisor", x=61, y=32, width=29, height=11,
            settings=("confirm", "within", "hold_off"),
        ),
        Block(
            id="master", label="Fusion", kind="master", x=61, y=52, width=35, height=13,
            settings=("master", "fusion_mode"),
        ),
    ]  # fmt: skip


def wires() -> list[Wire]:
    """What feeds what."""
    pairs: list[tuple[str, str, str | None]] = [
        ("gyro", "sins", None),
        ("accelerometer", "sins", None),
        ("sins", "models", None),
        ("models", "propagators", None),
        ("gps", "filter-gps", "gps"),
        ("bd2", "filter-bd2", "bd2"),
        ("cns", "filter-cns", "cns"),
        ("propagators", "filter-gps", None),
        ("propagators", "filter-bd2", None),
        ("propagators", "filter-cns", None),
        ("filter-gps", "supervisor", None),
        ("filter-bd2", "supervisor", None),
        ("filter-cns", "supervisor", None),
        ("filter-gps", "master", "gps"),
        ("filter-bd2", "master", "bd2"),
        ("filter-cns", "master", "cns"),
        ("supervisor", "master", None),
        ("master", "propagators", None),
    ]
    return [Wire(source=a, target=b, carries=c) for a, b, c in pairs]


def scene() -> list[SceneItem]:
    """What the scene shows."""
    items = [SceneItem(id="aircraft", label="aircraft", kind="aircraft", frame="level", family="aircraft")]
    for cluster in CLUSTERS:
        for axis in AXES:
            items.append(
                SceneItem(
                    id=f"axis.{cluster}.{axis}",
                    label=f"{cluster[0].upper()}{axis}",
                    kind="axis",
                    family="IMU" if axis in BODY else f"instrument {axis[0]}",
                    channel=f"imu.{cluster}.{axis}",
                )
            )
    items.append(
        SceneItem(id="boresight", label="CNS", kind="vector", family="star tracker", channel="cns.attitude.heading")
    )
    for name in NAMES:
        aid, slot = name.split(".")
        items.append(
            SceneItem(
                id=f"satellite.{name}",
                label=slot,
                kind="line-of-sight",
                frame="level",
                family=f"{aid.upper()} satellites",
                channel=f"{aid}.position.all",
            )
        )
    return items
