"""The diagram of the SINS/GPS/BD2/CNS system, and what its blocks say."""

from __future__ import annotations

from typing import Final

import numpy as np

from ftcore.description import Block, BlockView, Wire
from ftcore.parts.declared import Declared
from ftcore.parts.instruments import CLUSTERS
from ftcore.systems.reporting import Now, instruments_block, sensor_block, supervisor_block
from ftcore.systems.sins_gps_bd2_cns.aids import AIDS
from ftcore.systems.sins_gps_bd2_cns.weights import LABELS

_BOUNDS: Final = ("driving_test", "false_alarm_probability", "doubt_probability")
_WIRES: Final[tuple[tuple[str, str, str | None], ...]] = (
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
)
DECLARED: Final = Declared(
    blocks=(
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
        Block(id="filter-gps", label="GPS test", kind="test", x=27, y=29, width=26, height=11, settings=_BOUNDS),
        Block(id="filter-bd2", label="BD2 test", kind="test", x=27, y=42, width=26, height=11, settings=_BOUNDS),
        Block(id="filter-cns", label="CNS test", kind="test", x=27, y=55, width=26, height=11, settings=_BOUNDS),
        Block(
            id="supervisor", label="Supervisor", kind="supervisor", x=61, y=32, width=29, height=11,
            settings=("confirm", "within", "hold_off"),
        ),
        Block(
            id="master", label="Fusion", kind="master", x=61, y=52, width=35, height=13,
            settings=("master", "fusion_mode"),
        ),
    ),
    wires=tuple(Wire(source=a, target=b, carries=c) for a, b, c in _WIRES),
)  # fmt: skip


def blocks(now: Now, redundant: bool) -> dict[str, BlockView]:
    """What every block says; ``redundant``: which IMU is fitted."""
    said, settings = now.said, now.controls.settings
    driver = {"two-propagator": "innovation", "two-propagator-state": "state"}.get(settings.driving_test, "no test")
    reference, models, best, alone = "no. 1", "waiting", "waiting", False
    if said is not None:
        alpha = said["weight.{subset}"][0]
        age = said["propagator.{propagator}.age"][0, -1]
        reference = f"no. {int(said['propagator.reference'][0])}, {age:.0f} s old"
        models = f"Q large {100.0 * said['probability.{model}'][0, 1]:.0f} %"
        best = f"{100.0 * float(alpha.max()):.0f} % {list(LABELS.values())[int(alpha.argmax())]}"
        alone = float(alpha[0]) > 0.5
    lost = any(subject.startswith("imu") and state == "isolated" for subject, state in now.health.items())
    return {
        "gps": sensor_block(now, "gps", "position"),
        "bd2": sensor_block(now, "bd2", "position"),
        "cns": sensor_block(now, "cns", "attitude"),
        **{cluster: _instruments(now, cluster, redundant) for cluster in CLUSTERS},
        "sins": BlockView(health="isolated" if lost else "ok", text="redundant IMU" if redundant else "strapdown"),
        "models": BlockView(health="ok", text=models),
        "propagators": BlockView(health="ok", text=reference),
        **{f"filter-{aid}": _local(now, i, aid) for i, aid in enumerate(AIDS)},
        "supervisor": supervisor_block(now, f"all trusted ({driver})"),
        "master": BlockView(health="suspect" if alone else "ok", text=best),
    }


def _instruments(now: Now, cluster: str, redundant: bool) -> BlockView:
    if not redundant:
        return sensor_block(now, f"imu.{cluster}", "3 axes")
    return instruments_block(now, cluster)


def _local(now: Now, i: int, name: str) -> BlockView:
    if now.health[name] == "off":
        return BlockView(health="off", text="switched off")
    if now.said is None:
        return BlockView(health="ok", text="waiting")
    q, weight = now.said.of_test("two-propagator", "{aid}", "statistic")[0, i], now.said["validity.{aid}"][0, i]
    if not np.isfinite(q):
        return BlockView(health="off", text="no reading")
    return BlockView(health=now.health[name], text=f"q {q:.3g}, weight {weight:.2g}")
