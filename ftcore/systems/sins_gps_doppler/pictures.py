"""Diagram and 3-D scene of the SINS/GPS/Doppler system."""

from __future__ import annotations

from ftcore.description import Block, SceneItem, Wire
from ftcore.systems.sins_gps_doppler.names import AXES, CLUSTERS, SLOTS


def blocks() -> list[Block]:
    """The blocks and where they stand."""
    drives = ("driving_test", "false_alarm_probability", "propagator_period")
    return [
        Block(
            id="gps", label="GPS", kind="sensor", x=1, y=2, width=22, height=11, sensor="gps", subsystem="gps",
            settings=("satellite_integrity", "wrong_isolation_probability"),
        ),
        Block(id="gyro", label="Gyros", kind="sensor", x=1, y=16, width=22, height=11, sensor="imu.gyro"),
        Block(
            id="accelerometer", label="Accels", kind="sensor", x=1, y=29, width=22, height=11,
            sensor="imu.accelerometer",
        ),
        Block(
            id="altimeter", label="Altimeter", kind="sensor", x=1, y=42, width=22, height=11, sensor="altimeter",
            subsystem="altimeter",
        ),
        Block(
            id="doppler", label="Doppler", kind="sensor", x=1, y=55, width=22, height=11, sensor="doppler",
            subsystem="doppler",
        ),
        Block(
            id="imu-fdi", label="IMU FDI", kind="test", x=27, y=13, width=20, height=13, sensor="imu",
            settings=("imu_driving_test", "false_alarm_probability"),
        ),
        Block(id="sins", label="SINS", kind="computer", x=27, y=29, width=20, height=11),
        Block(
            id="altimeter-fdi", label="Altimeter FDI", kind="test", x=27, y=43, width=20, height=11,
            subsystem="altimeter", settings=("altimeter_driving_test", "false_alarm_probability"),
        ),
        Block(
            id="filter-gps", label="SINS/GPS", kind="filter", x=52, y=2, width=22, height=12, settings=("gps_share",)
        ),
        Block(id="tests", label="Tests", kind="test", x=52, y=26, width=22, height=15, settings=drives),
        Block(
            id="filter-doppler", label="SINS/Doppler", kind="filter", x=52, y=54, width=22, height=12,
            settings=("gps_share",),
        ),
        Block(
            id="supervisor", label="Supervisor", kind="supervisor", x=79, y=20, width=20, height=12,
            settings=("confirm", "within", "hold_off"),
        ),
        Block(
            id="master", label="Master", kind="master", x=79, y=40, width=20, height=14,
            settings=("fusion_mode", "master", "doubt_probability"),
        ),
    ]  # fmt: skip


def wires() -> list[Wire]:
    """What feeds what."""
    pairs: list[tuple[str, str, str | None]] = [
        ("gps", "filter-gps", None),
        ("gyro", "imu-fdi", None),
        ("accelerometer", "imu-fdi", None),
        ("imu-fdi", "sins", None),
        ("altimeter", "altimeter-fdi", None),
        ("altimeter-fdi", "sins", "altimeter"),
        ("doppler", "filter-doppler", None),
        ("sins", "filter-gps", None),
        ("sins", "filter-doppler", None),
        ("filter-gps", "tests", None),
        ("filter-doppler", "tests", None),
        ("tests", "supervisor", None),
        ("supervisor", "master", None),
        ("filter-gps", "master", "gps"),
        ("filter-doppler", "master", "doppler"),
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
                    family=f"instrument {axis[0]}",
                    channel=f"imu.{cluster}.{axis}",
                )
            )
    for k in (1, 2, 3):
        items.append(SceneItem(id=f"spin.{k}", label=f"spin {k}", kind="spin", family=f"instrument {k}"))
        items.append(SceneItem(id=f"plane.{k}", label=f"fault plane {k}", kind="plane", family=f"instrument {k}"))
    for cluster in CLUSTERS:
        items.append(
            SceneItem(id=f"parity.{cluster}", label=f"{cluster} parity", kind="vector", family="parity vector")
        )
    for slot in SLOTS:
        items.append(
            SceneItem(
                id=f"satellite.{slot}",
                label=slot,
                kind="line-of-sight",
                frame="level",
                family="satellites",
                channel=f"gps.pseudorange.{slot}",
            )
        )
    return items
