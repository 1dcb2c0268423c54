"""Truth and output to recorded numbers, and to the state of diagram and scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.description import BlockView, Health, ItemView, View
from ftcore.detection import raim
from ftcore.detection.protection import stanford
from ftcore.estimation import least_squares
from ftcore.systems.base import Controls, Flags, Output
from ftcore.systems.gps_receiver.integrity import Protection
from ftcore.systems.gps_receiver.names import ESTIMATORS, SATELLITES, SUBJECTS, TESTS
from ftcore.systems.reporting import healths

Array = NDArray[np.float64]

COMBINED = list(ESTIMATORS).index("combined")
SINGLE = [i for i, (test, subject) in enumerate(TESTS) if test == "snapshot" and subject != "gps"]
"""Columns of the snapshot test of each satellite; those in view share one threshold, the square of a residual's."""
LINE = 2.2
"""Length of a line of sight in the scene."""
_STATUS = ("consistent", "satellites excluded", "cannot isolate", "cannot detect", "no fix")
_CLASSES = ("nominal", "misleading", "hazardous", "unavailable")


@dataclass(frozen=True)
class Truth:
    """What really is: ``position_e (1, 3)`` [m] and ``C_en (1, 3, 3)`` there, the same for all runs."""

    position_e: Array
    C_en: Array


@dataclass(frozen=True)
class Detail:
    """What the navigator hands to the reporter; four estimators in the order of the names.

    Attributes:
        position_e, sigma: (runs, 4, 3), Earth-fixed; east, north, up [m]; NaN where there is no answer.
        status: (runs, 4) codes of :mod:`ftcore.detection.raim`.
        satellites: (runs, 4) how many each takes.
        hdop, dof: (runs,) of the snapshot.
        protection: of each estimator's satellites.
        columns: (n,) of the satellites that follow, among all names.
        unit_n: (runs, n, 3) lines of sight, NaN where there is no measurement.
        normalised: (runs, 2, n) residuals of the snapshot and of the filter's innovations, each against all others.
        trusted: (runs, n) whether the combined solution takes it.
        time: of the receiver, seconds of the GPS week.
    """

    position_e: Array
    sigma: Array
    status: NDArray[np.int8]
    satellites: NDArray[np.int64]
    hdop: Array
    dof: NDArray[np.int64]
    protection: Protection
    alert_limit: float
    columns: NDArray[np.intp]
    unit_n: Array
    normalised: Array
    trusted: Flags
    time: float


class Reporter:
    """See :class:`ftcore.systems.base.Reporter`."""

    def row(self, truth: Truth, output: Output) -> Array:
        """``(runs, signals)``; the order is that of the description's signals."""
        detail: Detail = output.detail
        runs = len(detail.status)
        error = (detail.position_e - truth.position_e[:, None]) @ truth.C_en
        horizontal = np.hypot(error[..., 0], error[..., 1])
        level = detail.protection.level
        declared = (detail.status <= raim.EXCLUDED) & np.isfinite(horizontal)
        verdict = stanford(horizontal, level, detail.alert_limit, declared)
        estimators = np.concatenate(
            [
                error,
                horizontal[..., None],
                detail.sigma,
                detail.status[..., None],
                detail.satellites[..., None],
                level[..., None],
                verdict[..., None],
            ],
            axis=-1,
        ).reshape(runs, -1)
        tests = np.stack([output.statistic, output.threshold, output.dof, output.alarm], axis=-1).reshape(runs, -1)
        p = detail.protection
        receiver = np.stack(
            [
                level[:, COMBINED],
                p.slope[:, COMBINED],
                p.separation[:, COMBINED],
                np.full(runs, detail.alert_limit),
                detail.hdop,
                detail.dof.astype(np.float64),
                np.isfinite(detail.unit_n[..., 0]).sum(axis=-1).astype(np.float64),
                np.full(runs, detail.time),
                np.sqrt(np.fmax.reduce(output.threshold[:, SINGLE], axis=-1)),
            ],
            axis=-1,
        )
        elevation, azimuth = least_squares.elevation(detail.unit_n), least_squares.azimuth(detail.unit_n)
        seen = np.isfinite(elevation)
        own = np.full((runs, 6, len(SATELLITES)), np.nan)
        own[:, :, detail.columns] = np.stack(
            [
                np.where(seen, detail.trusted, np.nan),
                detail.normalised[:, 0],
                detail.normalised[:, 1],
                p.detectable[:, 0],
                elevation,
                azimuth,
            ],
            axis=1,
        )
        return np.concatenate([estimators, tests, receiver, own.reshape(runs, -1)], axis=-1)

    def view(
        self, time: float, truth: Truth | None, output: Output | None, controls: Controls, faulted: frozenset[str]
    ) -> View:
        """Diagram and scene of run 0."""
        health = healths(SUBJECTS, output, controls)
        detail: Detail | None = None if output is None else output.detail
        errors = None
        if detail is not None and truth is not None:
            errors = np.linalg.norm(((detail.position_e - truth.position_e[:, None]) @ truth.C_en)[0, :, :2], axis=-1)
        return View(
            time=time,
            blocks=_blocks(output, errors, controls, health, faulted),
            items=_items(detail, controls, health, faulted),
        )


def _blocks(
    output: Output | None,
    errors: Array | None,
    controls: Controls,
    health: dict[str, Health],
    faulted: frozenset[str],
) -> dict[str, BlockView]:
    detail: Detail | None = None if output is None else output.detail
    broken = sum(name.startswith("gps.") for name in faulted)
    off = health["gps"] == "off"
    if off or detail is None or output is None or errors is None:
        text = "off" if off else "waiting"
        waiting = BlockView(health="ok", text="waiting")
        names = ("snapshot-test", "snapshot", "innovation-test", "filter", "combination", "combined", "protection")
        blocks = {name: waiting for name in (*names, "unprotected")}
        return {"satellites": BlockView(health="off" if off else "faulted" if broken else "ok", text=text), **blocks}
    in_view = int(np.isfinite(detail.unit_n[0, :, 0]).sum())
    lost = [s.removeprefix("gps.") for s in SUBJECTS[1:] if health[s] in ("isolated", "suspect")]
    status = dict(zip(ESTIMATORS, detail.status[0].tolist(), strict=True))

    def test(name: str) -> BlockView:
        alarms = [s for i, (n, s) in enumerate(TESTS) if n == name and output.alarm[0, i]]
        named = [s.removeprefix("gps.") for s in alarms if s != "gps"]
        if not alarms:
            return BlockView(health="ok", text="passed")
        return BlockView(health="suspect", text=f"{', '.join(named)[:16]} named" if named else "alarm, nobody named")

    def solution(name: str) -> BlockView:
        i = list(ESTIMATORS).index(name)
        code = status[name]
        doubt = code > raim.EXCLUDED
        error = f"{errors[i]:.0f} m off" if np.isfinite(errors[i]) else "no answer"
        return BlockView(health="suspect" if doubt else "ok", text=_STATUS[code] if doubt else error)

    level = float(detail.protection.level[0, COMBINED])
    good = np.array(status["combined"] <= raim.EXCLUDED)
    stanford_class = int(stanford(errors[COMBINED], np.array(level), detail.alert_limit, good))
    return {
        "satellites": BlockView(
            health="faulted" if broken else "ok", text=f"{in_view} in view" + (f", {broken} faulted" if broken else "")
        ),
        "snapshot-test": test("snapshot"),
        "snapshot": solution("snapshot"),
        "innovation-test": test("innovation"),
        "filter": solution("filter"),
        "combination": BlockView(
            health="isolated" if lost else "ok",
            text=f"{', '.join(lost)[:18]} out" if lost else controls.settings.combination,
        ),
        "combined": solution("combined"),
        "unprotected": solution("unprotected"),
        "protection": BlockView(
            health="ok" if stanford_class == 0 else "suspect",
            text=f"{_CLASSES[stanford_class]}, {level:.0f} m" if np.isfinite(level) else "no protection",
        ),
    }


def _items(
    detail: Detail | None, controls: Controls, health: dict[str, Health], faulted: frozenset[str]
) -> dict[str, ItemView]:
    lines = np.full((len(SATELLITES), 3), np.nan)
    if detail is not None and controls.enabled["gps"]:
        lines[detail.columns] = detail.unit_n[0]
    items: dict[str, ItemView] = {}
    for i, name in enumerate(SATELLITES):
        seen = bool(np.isfinite(lines[i, 0]))
        fate: Health = health[f"gps.{name}"]
        if fate not in ("isolated", "suspect"):
            broken = f"gps.pseudorange.{name}" in faulted or "gps.pseudorange.all" in faulted
            fate = "faulted" if broken else "ok"
        east, north, up = (LINE * float(v) for v in lines[i])
        items[f"satellite.{name}"] = ItemView(vector=(east, north, up) if seen else None, health=fate, visible=seen)
    return items
