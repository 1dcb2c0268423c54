"""Three F-16s on the same mission: with FDI, without, and a healthy twin; outside, how far the first two are off it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Block, BlockView, Chart, SceneItem, Trace
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.rotation import rpy_to_matrix
from ftcore.systems.reporting import Now
from ftcore.world.aircraft import S

Array = NDArray[np.float64]

EPOCH: Final = 0.02
FLOWN: Final = ("protected", "unprotected", "healthy")
"""The three aircraft, in the order of every array: with FDI, without, and one that nothing breaks."""
AIRCRAFT: Final = len(FLOWN)
PROTECTED, UNPROTECTED, HEALTHY = range(AIRCRAFT)
ESTIMATORS: Final = {"protected": "with FDI", "unprotected": "without FDI"}
LABELS: Final = {**ESTIMATORS, "healthy": "healthy twin"}
RATES: Final = slice(S.P, S.R + 1)
KILOMETRE: Final = 1000.0
"""Metres to a unit of the scene, for flight paths."""
_ERRORS: Final = {
    "position": ("m", "direction"),
    "velocity": ("m/s", "direction"),
    "attitude": ("deg", "angle"),
    "rate": ("deg/s", "rotation"),
}
"""Quantity -> unit, field of its parts."""


def _chart(id: str, title: str, unit: str, group: str, *traces: Trace) -> Chart:
    return Chart(id=id, title=title, unit=unit, group=group, traces=traces)


def _error_charts() -> tuple[Chart, ...]:
    found = []
    for quantity, (unit, field) in _ERRORS.items():
        title = f"{quantity.capitalize()}, {{{field}}}: off the healthy twin's"
        if quantity == "rate":
            title = f"{{{field}}} rate: error of what control flies on"
        trace = Trace(signal=f"{{estimator}}.error.{quantity}.{{{field}}}", label="{estimator}")
        found.append(_chart(f"{quantity}-{{{field}}}", title, unit, "errors", trace))
    return tuple(found)


DECLARED: Final = Declared(
    members={
        "aircraft": LABELS,
        "estimator": ESTIMATORS,
        "direction": {part: part for part in ("east", "north", "up")},
        "angle": {part: part for part in ("roll", "pitch", "heading")},
        "rotation": {part: part for part in ("roll", "pitch", "yaw")},
        "flow": {"alpha": "alpha", "beta": "beta"},
        "surface": {part: part for part in ("elevator", "aileron", "rudder")},
    },
    roles={"protected": "protected", "unprotected": "unprotected", "healthy": "local"},
    signals=(
        *(
            Signals(
                f"{{estimator}}.error.{quantity}.{{{field}}}",
                "{estimator}: "
                + ("rate error" if quantity == "rate" else f"{quantity} off the healthy twin's")
                + f", {{{field}}}",
                unit,
                "error",
            )
            for quantity, (unit, field) in _ERRORS.items()
        ),
        Signals("{estimator}.distance", "{estimator}: distance from the healthy twin", "m", "error"),
        Signals("path.{aircraft}.{direction}", "{aircraft}: way {direction}", "m", "flight"),
        Signals("height.{aircraft}", "{aircraft}: height", "m", "flight"),
        Signals("truth.speed", "true airspeed", "m/s", "flight"),
        Signals("truth.{flow}", "true {flow}", "deg", "flight"),
        Signals("truth.{angle}", "true {angle}", "deg", "flight"),
        Signals("control.throttle", "throttle", "1", "control"),
        Signals("control.{surface}", "{surface}", "deg", "control"),
    ),
    charts=(
        Chart(
            id="distance",
            title="Distance from the healthy twin (figure 8)",
            unit="m",
            group="flight",
            scale="log",
            traces=(Trace(signal="{estimator}.distance", label="{estimator}"),),
        ),
        _chart("height", "Height", "m", "flight", Trace(signal="height.{aircraft}", label="{aircraft}")),
        _chart("path-east", "Way east", "m", "flight", Trace(signal="path.{aircraft}.east", label="{aircraft}")),
        _chart("path-north", "Way north", "m", "flight", Trace(signal="path.{aircraft}.north", label="{aircraft}")),
        *_error_charts(),
        _chart(
            "attitude",
            "True attitude, with FDI",
            "deg",
            "flight",
            Trace(signal="truth.{angle}", label="{angle}"),
            Trace(signal="truth.{flow}", label="{flow}"),
        ),
        _chart(
            "surfaces",
            "Control surfaces, with FDI",
            "deg",
            "flight",
            Trace(signal="control.{surface}", label="{surface}"),
        ),
    ),
    blocks=(Block(id="mission", label="F-16", kind="computer", x=78, y=48, width=21, height=14),),
    scene=tuple(
        SceneItem(
            id=f"path.{name}",
            label=LABELS[name],
            kind="path",
            frame="level",
            picture="Flight paths",
            family=LABELS[name],
            trail=(f"path.{name}.east", f"path.{name}.north", f"path.{name}.up"),
            unit_length=KILOMETRE,
        )
        for name in ("protected", "healthy", "unprotected")
    ),
)


@dataclass(frozen=True)
class Truth:
    """States ``(runs, 3 aircraft, 13)`` at the end of an epoch."""

    x: Array


def report(say: Ledger, rates: Array, u: Array) -> None:
    """Rates handed to the control laws ``(runs, aircraft, 3)`` [rad/s] and controls ``(runs, aircraft, 4)``."""
    say.values["rates"] = rates
    say["control.throttle"], say["control.{surface}"] = u[:, PROTECTED, 0], u[:, PROTECTED, 1:]


def errors(truth: Truth, say: Ledger, start: Array) -> None:
    """What is flown, and how far the two aircraft are off the healthy twin, which started at ``start (3,)``."""
    x = truth.x
    where, velocity = x[..., S.EAST : S.UP + 1], _velocity(x)
    angles = x[..., S.ROLL : S.HEADING + 1]
    off = where - where[:, HEALTHY:]
    turned = np.remainder(angles - angles[:, HEALTHY:] + np.pi, 2.0 * np.pi) - np.pi
    two = slice(HEALTHY)
    say["{estimator}.error.position.{direction}"] = off[:, two]
    say["{estimator}.error.velocity.{direction}"] = (velocity - velocity[:, HEALTHY:])[:, two]
    say["{estimator}.error.attitude.{angle}"] = turned[:, two]
    say["{estimator}.error.rate.{rotation}"] = (say.values["rates"] - x[..., RATES])[:, two]
    say["{estimator}.distance"] = np.linalg.norm(off, axis=-1)[:, two]
    say["path.{aircraft}.{direction}"] = where - start
    say["height.{aircraft}"] = x[..., S.UP]
    mine = x[:, PROTECTED]
    say["truth.speed"], say["truth.{flow}"] = mine[:, S.SPEED], mine[:, [S.ALPHA, S.BETA]]
    attitude = mine[:, S.ROLL : S.HEADING + 1].copy()
    attitude[:, 2] = np.remainder(attitude[:, 2], 2.0 * np.pi)
    say["truth.{angle}"] = attitude
    for name, point in zip(FLOWN, (where[0] - start) / KILOMETRE, strict=True):
        say.draw(f"path.{name}", point)
    say.turn("aircraft", rpy_to_matrix(mine[0, S.ROLL : S.HEADING + 1]))


def _velocity(x: Array) -> Array:
    """Velocity ``(..., 3)``, east, north, up [m/s], of states ``(..., 13)``."""
    V, alpha, beta = x[..., S.SPEED], x[..., S.ALPHA], x[..., S.BETA]
    along = V * np.cos(beta)
    v_b = np.stack([along * np.cos(alpha), V * np.sin(beta), along * np.sin(alpha)], axis=-1)
    return np.asarray(np.matvec(rpy_to_matrix(x[..., S.ROLL : S.HEADING + 1]), v_b))


def blocks(now: Now) -> dict[str, BlockView]:
    """The diagram's block of the aircraft with FDI."""
    if now.said is None:
        return {"mission": BlockView(health="ok", text="climb, then turn")}
    height, roll = now.said["height.{aircraft}"][0, PROTECTED], now.said["truth.{angle}"][0, 0]
    text = f"bank {round(math.degrees(roll))}°, {height:.0f} m" if height > 0.0 else "on the ground"
    return {"mission": BlockView(health="ok", text=text)}
