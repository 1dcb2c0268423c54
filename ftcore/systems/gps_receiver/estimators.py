"""The receiver's four solutions: what is said of each, and outside, with truth, how far each is off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Block, BlockView, Chart, Trace, Wire
from ftcore.detection import raim
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.systems.reporting import Now

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

ESTIMATORS: Final = ("snapshot", "filter", "combined", "unprotected")
SNAPSHOT, COMBINED = ESTIMATORS.index("snapshot"), ESTIMATORS.index("combined")
AXES: Final = ("east", "north", "up")
STATES: Final = ("consistent", "satellites excluded", "cannot isolate", "cannot detect", "no fix")
"""Codes of :mod:`ftcore.detection.raim`, in words."""


def _errors(part: str, title: str, *more: Trace) -> Chart:
    sigma = f"{{estimator}}.sigma.position.{part}" if part in AXES else None
    every = Trace(signal=f"{{estimator}}.error.position.{part}", label="{estimator}", sigma=sigma)
    return Chart(id=f"position-{part}", title=title, unit="m", group="errors", traces=(every, *more))


DECLARED: Final = Declared(
    members={"estimator": {name: name for name in ESTIMATORS}, "axis": {name: name for name in AXES}},
    roles={"snapshot": "local", "filter": "local", "combined": "protected", "unprotected": "unprotected"},
    signals=(
        Signals("{estimator}.error.position.{axis}", "{estimator}: {axis} position error", "m", "error"),
        Signals("{estimator}.error.position.horizontal", "{estimator}: horizontal position error", "m", "error"),
        Signals("{estimator}.sigma.position.{axis}", "{estimator}: position {axis} 1-sigma", "m", "sigma"),
        Signals(
            "{estimator}.status",
            "{estimator}: " + ", ".join(f"{code} {words}" for code, words in enumerate(STATES)),
            "1",
            "integrity",
        ),
        Signals("{estimator}.satellites", "{estimator}: satellites used", "1", "geometry"),
    ),
    charts=(
        _errors(
            "horizontal",
            "Horizontal error and protection level",
            Trace(signal="protection.horizontal", label="protection level", role="threshold"),
            Trace(signal="protection.alert", label="alert limit", role="threshold"),
        ),
        _errors("east", "East position error"),
        _errors("north", "North position error"),
        _errors("up", "Height error"),
        Chart(
            id="status",
            title="Status of each solution",
            unit="1",
            group="integrity",
            levels=("ok", "satellites out", "cannot isolate", "cannot detect", "no fix"),
            traces=(Trace(signal="{estimator}.status", label="{estimator}"),),
        ),
        Chart(
            id="geometry",
            title="Satellites",
            unit="1",
            group="geometry",
            traces=(
                Trace(signal="gps.satellites", label="in view"),
                Trace(signal="combined.satellites", label="used"),
                Trace(signal="gps.dof", label="degrees of freedom"),
            ),
        ),
    ),
    blocks=(
        Block(
            id="combined", label="Combined", kind="master", x=78, y=20, width=21, height=12, settings=("reset_after",)
        ),
        Block(id="filter", label="Filter", kind="filter", x=52, y=38, width=23, height=11),
        Block(id="unprotected", label="Unprotected", kind="filter", x=52, y=54, width=23, height=11),
    ),
    wires=(Wire(source="satellites", target="unprotected"),),
)  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """What really is: ``position_e (1, 3)`` [m] and ``C_en (1, 3, 3)`` there, the same for all runs."""

    position_e: Array
    C_en: Array


def report(say: Ledger, position_e: Array, sigma: Array, status: Codes, satellites: NDArray[np.int64]) -> None:
    """What the navigator knows of its solutions.

    Args:
        position_e: ``(runs, estimators, 3)`` Earth-fixed [m]; NaN where there is no answer.
        sigma: ``(runs, estimators, 3)`` east, north, up [m].
        status: ``(runs, estimators)`` codes of :mod:`ftcore.detection.raim`.
        satellites: ``(runs, estimators)`` how many each takes.
    """
    say.values["position_e"] = position_e
    say["{estimator}.sigma.position.{axis}"] = sigma
    say["{estimator}.status"] = status
    say["{estimator}.satellites"] = satellites


def errors(truth: Truth, say: Ledger) -> None:
    """How far each solution is off."""
    error = (say.values["position_e"] - truth.position_e[:, None]) @ truth.C_en
    say["{estimator}.error.position.{axis}"] = error
    say["{estimator}.error.position.horizontal"] = np.hypot(error[..., 0], error[..., 1])


def blocks(now: Now) -> dict[str, BlockView]:
    """The diagram's blocks of the solutions."""
    if now.said is None or now.health["gps"] == "off":
        return {}
    status, off = now.said["{estimator}.status"][0], now.said["{estimator}.error.position.horizontal"][0]
    found = {}
    for name, code, error in zip(ESTIMATORS, status.astype(int).tolist(), off.tolist(), strict=True):
        text = f"{error:.0f} m off" if np.isfinite(error) else "no answer"
        doubt = code > raim.EXCLUDED
        found[name] = BlockView(health="suspect" if doubt else "ok", text=STATES[code] if doubt else text)
    return found
