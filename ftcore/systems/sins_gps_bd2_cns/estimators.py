"""The estimators that are shown and scored, their charts, and those of the flight."""

from __future__ import annotations

from typing import Any, Final

from ftcore.description import Chart, Trace
from ftcore.parts import navigation
from ftcore.parts.declared import Declared
from ftcore.parts.navigation import drift_chart, error_chart, nees_chart
from ftcore.systems.sins_gps_bd2_cns.aids import AIDS

ESTIMATORS: Final = {
    "fused": "fault-tolerant, IMM",
    "without-imm": "fault-tolerant, without IMM",
    "unprotected": "unprotected",
    "gps": "SINS/GPS alone",
    "bd2": "SINS/BD2 alone",
    "cns": "SINS/CNS alone",
}
ROLES: Final[dict[str, Any]] = {
    "fused": "protected",
    "without-imm": "component",
    "unprotected": "unprotected",
    "gps": "local",
    "bd2": "local",
    "cns": "local",
}
UNITS: Final = {"position": "m", "velocity": "m/s", "attitude": "arcsec"}


def _compared(quantity: str, axis: str, title: str) -> Chart:
    # Without the IMM a wrong reference may cost kilometres: that has charts of its own.
    both = ((name, ESTIMATORS[name], ROLES[name]) for name in ("fused", "unprotected"))
    return error_chart(quantity, axis, title, UNITS[quantity], *both)


def _imm(quantity: str, axis: str, title: str) -> Chart:
    both = ((name, ESTIMATORS[name], ROLES[name]) for name in ("without-imm", "fused"))
    chart = error_chart(quantity, axis, f"{title} error, with and without IMM", UNITS[quantity], *both)
    return chart.model_copy(update={"id": f"imm-{chart.id}", "group": "with and without IMM"})


def _alone(quantity: str, axis: str, title: str) -> Chart:
    traces = tuple(
        Trace(signal=f"{aid}.error.{quantity}.{axis}", label=ESTIMATORS[aid], role="local")
        for aid in AIDS
        # The star tracker says nothing of position: kilometres, that would flatten the others.
        if not (aid == "cns" and quantity != "attitude")
    )
    return Chart(
        id=f"alone-{quantity}-{axis}",
        title=f"{title} error, one aid alone",
        unit=UNITS[quantity],
        group="one aid alone",
        traces=traces,
    )


def _flight(id: str, title: str, unit: str, *angles: tuple[str, str]) -> Chart:
    traces = tuple(Trace(signal=f"truth.{name}", label=label) for name, label in angles)
    return Chart(id=id, title=f"Flight: {title}", unit=unit, group="flight", traces=traces)


DECLARED: Final = navigation.declared(ESTIMATORS, ROLES, "arcsec") + Declared(
    charts=(
        _compared("position", "east", "East position error"),
        _compared("position", "north", "North position error"),
        _compared("position", "up", "Altitude error"),
        _compared("velocity", "east", "East velocity error"),
        _compared("velocity", "north", "North velocity error"),
        _compared("velocity", "up", "Vertical velocity error"),
        _compared("attitude", "east", "East tilt error"),
        _compared("attitude", "north", "North tilt error"),
        _compared("attitude", "up", "Azimuth error"),
        _imm("position", "east", "East position"),
        _imm("velocity", "east", "East velocity"),
        _imm("attitude", "up", "Azimuth"),
        _alone("position", "east", "East position"),
        _alone("position", "north", "North position"),
        _alone("position", "up", "Altitude"),
        _alone("attitude", "up", "Azimuth"),
        drift_chart("cns", "Position error of SINS/CNS alone", "one aid alone"),
        nees_chart(
            *(
                Trace(signal=f"{name}.nees", label=ESTIMATORS[name], role=ROLES[name])
                for name in ("fused", "without-imm", "unprotected")
            )
        ),
        _flight("attitude-true", "roll and pitch", "deg", ("roll", "roll"), ("pitch", "pitch")),
        _flight("speed", "speed", "m/s", ("speed", "ground speed")),
        _flight("height", "height", "m", ("height", "height")),
    ),
)
