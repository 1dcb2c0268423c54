"""Estimates of position, velocity and attitude: what is said of each, and outside, with truth, how far each is off.

Of every estimator there are nine errors, east, north and up, their sigmas, the horizontal error and the NEES; and of
the flight itself what is really flown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Chart, Trace
from ftcore.estimation import kalman
from ftcore.estimation.ins_error import navigation_error
from ftcore.estimation.strapdown import InsState
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger

Array = NDArray[np.float64]

QUANTITIES = ("position", "velocity", "attitude")
"""Of each east, north and up, in the order of the nine navigation errors."""


@dataclass(frozen=True)
class Truth:
    """What really is, at the end of an epoch: arrays lead with 1, all runs fly the same path."""

    lla: Array
    v_n: Array
    C_nb: Array
    rpy: Array


def declared(estimators: Mapping[str, str], roles: Mapping[str, str], attitude_unit: str) -> Declared:
    """What is recorded of these estimators (name -> label), drawn in these roles, and of the flight."""
    units = dict(zip(QUANTITIES, ("m", "m/s", attitude_unit), strict=True))
    return Declared(
        members={"estimator": estimators, "axis": {axis: axis for axis in ("east", "north", "up")}},
        roles={"estimator": roles},
        signals=(
            *(
                Signals(f"{{estimator}}.{kind}.{q}.{{axis}}", f"{{estimator}}: {q} {{axis}} {words}", unit, kind)
                for kind, words in (("error", "error"), ("sigma", "1-sigma"))
                for q, unit in units.items()
            ),
            Signals("{estimator}.error.position.horizontal", "{estimator}: horizontal position error", "m", "error"),
            Signals("{estimator}.nees", "{estimator}: NEES, 9 states", "1", "consistency"),
            Signals("truth.height", "true height", "m", "flight"),
            Signals("truth.speed", "true ground speed", "m/s", "flight"),
            *(Signals(f"truth.{angle}", f"true {angle}", "deg", "flight") for angle in ("roll", "pitch", "heading")),
        ),
    )


def nees_chart(*traces: Trace) -> Chart:
    """Consistency of some estimators."""
    return Chart(
        id="nees",
        title="Consistency: NEES of 9 states",
        unit="1",
        group="consistency",
        scale="log",
        traces=traces,
    )


def report(say: Ledger, ins: InsState, corrects: list[int], x: Array, P: Array) -> None:
    """What the navigator knows.

    Args:
        ins: strapdowns, leading axes ``(runs, strapdowns)``.
        corrects: which of them each estimator corrects.
        x, P: the nine navigation errors as each estimator sees them, ``(runs, estimators, 9)`` and ``(..., 9, 9)``.
    """
    sigma = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    for i, quantity in enumerate(QUANTITIES):
        say[f"{{estimator}}.sigma.{quantity}.{{axis}}"] = sigma[..., 3 * i : 3 * i + 3]
    say.values["navigation"] = (ins, corrects, x, P)


def errors(truth: Truth, say: Ledger) -> None:
    """How far each estimate is off, and what is really flown."""
    found: tuple[InsState, list[int], Array, Array] = say.values["navigation"]
    ins, corrects, x, P = found
    true = InsState(truth.lla[:, None], truth.v_n[:, None], truth.C_nb[:, None])
    error = navigation_error(ins, true)[:, corrects] - x
    for i, quantity in enumerate(QUANTITIES):
        say[f"{{estimator}}.error.{quantity}.{{axis}}"] = error[..., 3 * i : 3 * i + 3]
    say["{estimator}.error.position.horizontal"] = np.sqrt(error[..., 0] ** 2 + error[..., 1] ** 2)
    say["{estimator}.nees"] = kalman.nees(error, P)
    say["truth.height"], say["truth.speed"] = truth.lla[:, 2], np.linalg.norm(truth.v_n, axis=-1)
    for i, angle in enumerate(("roll", "pitch", "heading")):
        say[f"truth.{angle}"] = truth.rpy[:, i]
    say.turn("aircraft", truth.C_nb[0])


def error_chart(quantity: str, axis: str, title: str, unit: str, *estimators: tuple[str, str, Any]) -> Chart:
    """An error of these estimators (name, label, role); the first one has its band."""
    return Chart(
        id=f"{quantity}-{axis}",
        title=title,
        unit=unit,
        group="errors",
        traces=tuple(
            Trace(
                signal=f"{name}.error.{quantity}.{axis}",
                label=label,
                role=role,
                sigma=f"{name}.sigma.{quantity}.{axis}" if i == 0 else None,
            )
            for i, (name, label, role) in enumerate(estimators)
        ),
    )


def drift_chart(estimator: str, title: str, group: str) -> Chart:
    """Position error of one estimator that never learns its position, which would flatten the others."""
    axes = ("east", "north", "up")
    traces = tuple(Trace(signal=f"{estimator}.error.position.{axis}", label=axis) for axis in axes)
    return Chart(id=f"position-{estimator}", title=title, unit="m", group=group, traces=traces)
