"""The diagram of the SINS/GPS/Doppler system, and what its blocks say."""

from __future__ import annotations

from typing import Final

from ftcore.description import Block, BlockView, Wire
from ftcore.parts.declared import Declared
from ftcore.parts.instruments import CLUSTERS
from ftcore.systems.reporting import Now, instruments_block, sensor_block, supervisor_block
from ftcore.systems.sins_gps_doppler.aid_tests import TESTS
from ftcore.systems.sins_gps_doppler.aids import AIDS

_DRIVES: Final = ("driving_test", "false_alarm_probability", "propagator_period")
_WIRES: Final[tuple[tuple[str, str, str | None], ...]] = (
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
)
DECLARED: Final = Declared(
    blocks=(
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
        Block(id="tests", label="Tests", kind="test", x=52, y=26, width=22, height=15, settings=_DRIVES),
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
    ),
    wires=tuple(Wire(source=a, target=b, carries=c) for a, b, c in _WIRES),
)  # fmt: skip


def blocks(now: Now) -> dict[str, BlockView]:
    """What every block says."""
    said, settings, health = now.said, now.controls.settings, now.health
    satellites = "waiting"
    unclear: list[str] = []
    named: list[str] = []
    alarms = 0
    if said is not None:
        taken, out = int(said["gps.satellites"][0]), int(said["gps.excluded"][0])
        satellites = f"{taken} of {taken + out} used" if out else f"{taken} satellites"
        alarmed = said.alarms()
        unclear = [subject.removeprefix("imu.") for test, subject in alarmed if test == "parity-trusted"]
        named = sorted({s.removeprefix("imu.") for _, s in alarmed if s.startswith("imu.") and s.count(".") == 2})
        alarms = sum(test in {t.name for t in TESTS} or test == "integrity" for test, _ in alarmed)
    used = [n for n in AIDS if (health[n] == "ok" if said is None else said.is_used(n))]
    degraded = any(subject.startswith("imu") and state == "isolated" for subject, state in health.items())
    return {
        "gps": sensor_block(now, "gps", satellites),
        "altimeter": sensor_block(now, "altimeter", "1 reading"),
        "doppler": sensor_block(now, "doppler", "3 axes"),
        **{cluster: instruments_block(now, cluster) for cluster in CLUSTERS},
        "imu-fdi": BlockView(
            health="suspect" if named or unclear else "ok",
            text=" ".join(f"{n}: cannot isolate" for n in unclear[:1])
            or " ".join(named)[:26]
            or f"{settings.imu_driving_test}",
        ),
        "altimeter-fdi": _taken(now, "altimeter", ("damps height", "no damping")),
        "sins": BlockView(health="ok", text="degraded IMU" if degraded else "strapdown"),
        **{f"filter-{aid}": _taken(now, aid, ("in the master", "no measurement")) for aid in AIDS},
        "tests": BlockView(
            health="suspect" if alarms else "ok",
            text=f"{alarms} alarm{'s' if alarms > 1 else ''}" if alarms else f"{settings.driving_test} drives",
        ),
        "supervisor": supervisor_block(now, "all trusted"),
        "master": BlockView(health="ok" if used else "suspect", text=f"{len(used)} of {len(AIDS)} filters used"),
    }


def _taken(now: Now, subject: str, words: tuple[str, str]) -> BlockView:
    """Whether a subject's readings are taken; ``words``: taken, and switched off."""
    health = now.health[subject]
    if now.said is not None and health == "ok" and not now.said.is_used(subject):
        return BlockView(health="off", text="no reading")
    texts = {"ok": words[0], "suspect": "withheld", "isolated": "excluded", "off": words[1]}
    return BlockView(health=health, text=texts[health])
