"""Truth and output to recorded numbers, and to the state of diagram and scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.description import BlockView, Health, ItemView, View
from ftcore.detection.geometry import Cluster
from ftcore.estimation.ins_error import navigation_error
from ftcore.estimation.strapdown import InsState
from ftcore.systems.base import Controls, Output
from ftcore.systems.reporting import (
    LEVEL,
    Truth,
    columns_of_tests,
    flight_columns,
    healths,
    navigation_columns,
    quaternion,
    vector,
)
from ftcore.systems.sins_gps_doppler.names import AIDS, ALTIMETER, AXES, CLUSTERS, SLOTS, SUBJECTS, TESTS

Array = NDArray[np.float64]

INS_OF_ESTIMATOR = [0, 0, 0, 1]
"""fused, gps and doppler correct the protected strapdown, unprotected its own."""


@dataclass(frozen=True)
class Detail:
    """What the navigator hands to the reporter.

    Attributes:
        ins: protected and unprotected strapdown, leading axes ``(runs, 2)``.
        x, P: the nine navigation errors as the four estimators see them, ``(runs, 4, 9)`` and ``(runs, 4, 9, 9)``.
        parity: ``(runs, 2, 3)`` calibrated parity vectors, gyros and accelerometers [SI].
        doppler: reading and estimated output ``(runs, 2, 3)`` [m/s].
        discrepancy: ``(runs, satellites)`` pseudorange minus its estimated output [m], NaN where there is none.
        altimeter: ``(runs,)`` strapdown minus altimeter minus what was predicted of that [m], NaN without a reading.
        lines: ``(satellites, 3)`` lines of sight of run 0, NaN where not visible.
        in_use, excluded: ``(runs,)`` satellites in use, and those left out by satellite integrity.
        hdop: ``(runs,)``.
        weights: ``(runs, 4)`` of the subsets of the aids.
        names: texts of the tests for the diagram.
    """

    ins: InsState
    x: Array
    P: Array
    parity: Array
    doppler: Array
    discrepancy: Array
    altimeter: Array
    lines: Array
    in_use: Array
    excluded: Array
    hdop: Array
    weights: Array


class Reporter:
    """See :class:`ftcore.systems.base.Reporter`."""

    def __init__(self, cluster: Cluster) -> None:
        self._axes = cluster.H
        pairs = cluster.H.reshape(3, 2, 3)
        self._spin = np.cross(pairs[:, 0], pairs[:, 1])
        columns = cluster.V.T.reshape(3, 2, 3)
        normals = np.cross(columns[:, 0], columns[:, 1])
        self._normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True)

    def row(self, truth: Truth, output: Output) -> Array:
        """``(runs, signals)``; the order is that of the description's signals."""
        detail: Detail = output.detail
        runs = len(detail.x)
        true = InsState(truth.lla[:, None], truth.v_n[:, None], truth.C_nb[:, None])
        truth_error = navigation_error(detail.ins, true)[:, INS_OF_ESTIMATOR]
        error = truth_error - detail.x
        outputs = np.swapaxes(detail.doppler, 1, 2).reshape(runs, -1)
        return np.concatenate(
            [
                navigation_columns(error, detail.P),
                columns_of_tests(output),
                detail.parity.reshape(runs, -1),
                output.used,
                outputs,
                detail.discrepancy,
                -detail.altimeter[:, None],
                detail.in_use[:, None],
                detail.excluded[:, None],
                detail.hdop[:, None],
                detail.weights,
                flight_columns(truth, runs),
            ],
            axis=-1,
        )

    def view(
        self, time: float, truth: Truth | None, output: Output | None, controls: Controls, faulted: frozenset[str]
    ) -> View:
        """Diagram and scene of run 0."""
        health = healths(SUBJECTS, output, controls)
        alarms: list[str] = []
        if output is not None:
            alarms = [f"{test} {subject}" for i, (test, subject) in enumerate(TESTS) if output.alarm[0, i]]
        blocks = self._blocks(output, controls, health, alarms, faulted)
        return View(time=time, blocks=blocks, items=self._items(truth, output, health, faulted))

    def _blocks(
        self,
        output: Output | None,
        controls: Controls,
        health: dict[str, Health],
        alarms: list[str],
        faulted: frozenset[str],
    ) -> dict[str, BlockView]:
        detail: Detail | None = None if output is None else output.detail

        def sensor(name: str, text: str) -> BlockView:
            number = sum(c.startswith(name + ".") for c in faulted)
            off = not controls.enabled.get(name, True)
            note = f", {number} faulted" if number else ""
            return BlockView(health="off" if off else "faulted" if number else "ok", text="off" if off else text + note)

        def instruments(cluster: str) -> BlockView:
            lost = [k for k in (1, 2, 3) if health[f"imu.{cluster}.{k}"] != "ok"]
            view = sensor(f"imu.{cluster}", f"{6 - 2 * len(lost)} of 6 axes")
            worst: Health = "isolated" if lost and view.health == "ok" else view.health
            return BlockView(health=worst, text=view.text)

        def local(name: str) -> BlockView:
            if output is not None and health[name] == "ok" and not output.used[0, SUBJECTS.index(name)]:
                return BlockView(health="off", text="no reading")
            texts = {"ok": "in the master", "suspect": "withheld", "isolated": "excluded", "off": "no measurement"}
            return BlockView(health=health[name], text=texts[health[name]])

        satellites = "waiting"
        if detail is not None:
            taken, out = int(detail.in_use[0]), int(detail.excluded[0])
            satellites = f"{taken} of {taken + out} used" if out else f"{taken} satellites"
        unclear = [a.split(".")[1] for a in alarms if a.startswith("parity-trusted")]
        imu_alarms = sorted({a.split(" ")[1] for a in alarms if "imu." in a and a.count(".") == 2})
        aid_alarms = [a for a in alarms if "imu." not in a and not a.endswith(f" {ALTIMETER}")]
        isolated = [s for s in SUBJECTS if health[s] == "isolated"]
        suspects = [s for s in SUBJECTS if health[s] == "suspect"]
        used = [n for n in AIDS if (health[n] == "ok" if output is None else output.used[0, SUBJECTS.index(n)])]
        driver = controls.settings.driving_test
        return {
            "gps": sensor("gps", satellites),
            "gyro": instruments("gyro"),
            "accelerometer": instruments("accelerometer"),
            "altimeter": sensor("altimeter", "1 reading"),
            "doppler": sensor("doppler", "3 axes"),
            "imu-fdi": BlockView(
                health="suspect" if imu_alarms or unclear else "ok",
                text=" ".join(f"{n}: cannot isolate" for n in unclear[:1])
                or " ".join(n.removeprefix("imu.") for n in imu_alarms)[:26]
                or f"{controls.settings.imu_driving_test}",
            ),
            "altimeter-fdi": self._altimeter(output, health["altimeter"]),
            "sins": BlockView(
                health="ok", text="degraded IMU" if any(s.startswith("imu") for s in isolated) else "strapdown"
            ),
            "filter-gps": local("gps"),
            "filter-doppler": local("doppler"),
            "tests": BlockView(
                health="suspect" if aid_alarms else "ok",
                text=f"{len(aid_alarms)} alarm{'s' if len(aid_alarms) > 1 else ''}"
                if aid_alarms
                else f"{driver} drives",
            ),
            "supervisor": BlockView(
                health="isolated" if isolated else "suspect" if suspects else "ok",
                text=(", ".join(s.removeprefix("imu.") for s in isolated) + " out")
                if isolated
                else ("suspects " + ", ".join(s.removeprefix("imu.") for s in suspects))
                if suspects
                else "all trusted",
            ),
            "master": BlockView(health="ok" if used else "suspect", text=f"{len(used)} of {len(AIDS)} filters used"),
        }

    def _altimeter(self, output: Output | None, health: Health) -> BlockView:
        """The altimeter's test: whether its reading damps the vertical channel."""
        texts = {"ok": "damps height", "suspect": "withheld", "isolated": "excluded", "off": "no damping"}
        if output is not None and health == "ok" and not output.used[0, SUBJECTS.index(ALTIMETER)]:
            return BlockView(health="off", text="no reading")
        return BlockView(health=health, text=texts[health])

    def _items(
        self, truth: Truth | None, output: Output | None, health: dict[str, Health], faulted: frozenset[str]
    ) -> dict[str, ItemView]:
        def state(channel: str, subject: str) -> Health:
            if health[subject] in ("isolated", "off"):
                return health[subject]
            return "faulted" if channel in faulted else health[subject]

        items: dict[str, ItemView] = {}
        for cluster, length in (("gyro", 1.0), ("accelerometer", 0.65)):
            for i, axis in enumerate(AXES):
                items[f"axis.{cluster}.{axis}"] = ItemView(
                    vector=vector(length * self._axes[i]),
                    health=state(f"imu.{cluster}.{axis}", f"imu.{cluster}.{axis[0]}"),
                )
        for k in (1, 2, 3):
            items[f"spin.{k}"] = ItemView(vector=vector(0.8 * self._spin[k - 1]))
            items[f"plane.{k}"] = ItemView(vector=vector(self._normals[k - 1]))
        detail: Detail | None = None if output is None else output.detail
        for c, cluster in enumerate(CLUSTERS):
            shown = (0.0, 0.0, 0.0)
            alarm = False
            if output is not None and detail is not None:
                column = TESTS.index(("parity", f"imu.{cluster}"))
                ratio = np.sqrt(np.nan_to_num(output.statistic[0, column] / output.threshold[0, column]))
                p = detail.parity[0, c]
                shown = vector(p / max(float(np.linalg.norm(p)), 1e-30) * min(float(ratio), 2.0))
                alarm = bool(output.alarm[0, column])
            items[f"parity.{cluster}"] = ItemView(
                vector=shown, health="suspect" if alarm else "ok", visible=output is not None
            )
        everything = any(name.startswith("gps.") and name.endswith(".all") for name in faulted)
        for i, slot in enumerate(SLOTS):
            line = None if detail is None else detail.lines[i]
            seen = line is not None and bool(np.isfinite(line[0]))
            broken = everything or any(f"gps.{q}.{slot}" in faulted for q in ("pseudorange", "delta_range"))
            whole, fate = health["gps"], health[f"gps.{slot}"]
            if fate != "isolated":
                fate = "faulted" if broken else "isolated" if whole in ("isolated", "off") else fate
            items[f"satellite.{slot}"] = ItemView(
                vector=vector(1.5 * line) if seen and line is not None else None, health=fate, visible=seen
            )
        if truth is not None:
            items["aircraft"] = ItemView(rotation=quaternion(truth.C_nb[0]))
        else:
            items["aircraft"] = ItemView(rotation=LEVEL)
        return items
