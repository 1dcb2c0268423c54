"""The estimators that are shown and scored, and their charts."""

from __future__ import annotations

from typing import Any, Final

from ftcore.description import Chart, Trace
from ftcore.parts import navigation
from ftcore.parts.declared import Declared
from ftcore.parts.navigation import drift_chart, error_chart, nees_chart

ESTIMATORS: Final = {
    "fused": "fault-tolerant",
    "gps": "SINS/GPS alone",
    "doppler": "SINS/Doppler alone",
    "unprotected": "unprotected",
}
ROLES: Final = {"fused": "protected", "gps": "local", "doppler": "local", "unprotected": "unprotected"}
CORRECTS: Final = [0, 0, 0, 1]
"""fused, gps and doppler correct the protected strapdown, unprotected its own."""


def _chart(quantity: str, axis: str, title: str) -> Chart:
    # Doppler alone never learns its position: tens of metres, that would flatten the others.
    shown = [name for name in ESTIMATORS if not (quantity == "position" and name == "doppler")]
    traces: list[tuple[str, str, Any]] = [(name, ESTIMATORS[name], ROLES[name]) for name in shown]
    unit = {"position": "m", "velocity": "m/s", "attitude": "mrad"}[quantity]
    return error_chart(quantity, axis, title, unit, *traces)


DECLARED: Final = navigation.declared(ESTIMATORS, ROLES, "mrad") + Declared(
    charts=(
        _chart("position", "up", "Altitude error"),
        _chart("position", "east", "East position error"),
        _chart("position", "north", "North position error"),
        _chart("velocity", "east", "East velocity error"),
        _chart("velocity", "north", "North velocity error"),
        _chart("velocity", "up", "Vertical velocity error"),
        _chart("attitude", "east", "East tilt error"),
        _chart("attitude", "north", "North tilt error"),
        _chart("attitude", "up", "Azimuth error"),
        drift_chart("doppler", "Position error of SINS/Doppler alone", "errors"),
        nees_chart(Trace(signal="{estimator}.nees", label="{estimator}")),
    ),
)
