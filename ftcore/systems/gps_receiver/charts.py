"""The charts that the GPS receiver offers."""

from __future__ import annotations

from typing import Final, Literal

from ftcore.description import Chart, Region, Trace
from ftcore.systems.declarations import capital, chart_of_test
from ftcore.systems.gps_receiver.names import ESTIMATORS, SATELLITES, TEST_LABELS

_ROLES: Final[dict[str, Literal["protected", "local", "unprotected"]]] = {
    "snapshot": "local",
    "filter": "local",
    "combined": "protected",
    "unprotected": "unprotected",
}
STATUS: Final = ("ok", "satellites out", "cannot isolate", "cannot detect", "no fix")
"""Codes of :mod:`ftcore.detection.raim`, in words."""
REGIONS: Final = (
    Region(
        label="nominal",
        meaning="the protection level covers the error",
        health="ok",
        corners=(("zero", "zero"), ("limit", "limit"), ("zero", "limit")),
    ),
    Region(
        label="MI",
        meaning="misleading: the error is beyond the protection level, but not beyond the alert limit",
        health="suspect",
        corners=(("zero", "zero"), ("limit", "zero"), ("limit", "limit")),
    ),
    Region(
        label="HMI",
        meaning="hazardously misleading: the error is beyond the alert limit while the position is vouched for",
        health="faulted",
        corners=(("limit", "zero"), ("end", "zero"), ("end", "limit"), ("limit", "limit")),
    ),
    Region(
        label="unavailable",
        meaning="the protection level is beyond the alert limit, or nobody vouches for the position",
        health="off",
        corners=(("zero", "limit"), ("end", "limit"), ("end", "end"), ("zero", "end")),
    ),
)
"""The Stanford diagram, in the order of the classes of :func:`ftcore.detection.protection.stanford`."""


def charts() -> list[Chart]:
    """All of them; those marked as shown are open at first."""
    levels = (
        Trace(signal="combined.error.position.horizontal", label="error, combined", role="protected"),
        Trace(signal="protection.slope", label="slope", role="component"),
        Trace(signal="protection.separation", label="solution separation", role="component"),
        Trace(signal="protection.alert", label="alert limit", role="threshold"),
    )
    geometry = (
        Trace(signal="gps.satellites", label="in view"),
        Trace(signal="combined.satellites", label="used"),
        Trace(signal="gps.dof", label="degrees of freedom"),
    )
    return [
        _error_chart("horizontal", "Horizontal error and protection level", shown=True),
        _sky(),
        _residual_bars(),
        _stanford("combined", shown=True),
        _test_chart("snapshot", shown=True),
        _test_chart("innovation", shown=True),
        _satellite_chart("residuals", "Residuals of the satellites, in σ", "1", "residuals", "residual.snapshot.{}"),
        _satellite_chart(
            "innovations", "Innovations of the satellites, in σ", "1", "residuals", "residual.innovation.{}"
        ),
        _codes("status", "Status of each solution", "status", STATUS),
        _codes("stanford", "Stanford class of each solution", "stanford", tuple(region.label for region in REGIONS)),
        Chart(id="protection", title="Protection levels", unit="m", group="integrity", traces=levels),
        *(_stanford(name) for name in ESTIMATORS if name != "combined"),
        _satellite_chart("detectable", "Minimal detectable bias", "m", "integrity", "detectable.{}"),
        _error_chart("east", "East position error"),
        _error_chart("north", "North position error"),
        _error_chart("up", "Height error"),
        _test_chart("parity"),
        _test_chart("agreement"),
        Chart(id="geometry", title="Satellites", unit="1", group="geometry", traces=geometry),
        Chart(id="hdop", title="HDOP", unit="1", group="geometry", traces=(Trace(signal="gps.hdop", label="HDOP"),)),
        _satellite_chart("elevation", "Elevation", "deg", "geometry", "elevation.{}"),
    ]


def _error_chart(part: str, title: str, shown: bool = False) -> Chart:
    traces = [
        Trace(
            signal=f"{estimator}.error.position.{part}",
            label=label,
            role=_ROLES[estimator],
            sigma=f"combined.sigma.position.{part}" if estimator == "combined" and part != "horizontal" else None,
        )
        for estimator, label in ESTIMATORS.items()
    ]
    if part == "horizontal":
        traces.append(Trace(signal="protection.horizontal", label="protection level", role="threshold"))
        traces.append(Trace(signal="protection.alert", label="alert limit", role="threshold"))
    return Chart(id=f"position-{part}", title=title, unit="m", group="errors", traces=tuple(traces), shown=shown)


def _sky() -> Chart:
    """Where the satellites are, and how each fares."""
    return Chart(
        id="sky",
        title="Sky",
        unit="deg",
        group="geometry",
        kind="sky",
        traces=tuple(
            Trace(signal=f"elevation.{name}", across=f"azimuth.{name}", label=name, item=f"satellite.{name}")
            for name in SATELLITES
        ),
        shown=True,
    )


def _residual_bars() -> Chart:
    """Who disagrees with all others now: the normalised residuals of the snapshot, whose squares are tested."""
    bars = [Trace(signal=f"residual.snapshot.{n}", label=n, item=f"satellite.{n}") for n in SATELLITES]
    limit = Trace(signal="residual.threshold", label="threshold", role="threshold")
    return Chart(
        id="residual-bars",
        title="Residuals, in σ",
        unit="1",
        group="residuals",
        kind="bars",
        traces=(*bars, limit),
        shown=True,
    )


def _stanford(estimator: str, shown: bool = False) -> Chart:
    """Protection level over the true error, an epoch a point."""
    cloud = Trace(
        signal=f"{estimator}.protection",
        across=f"{estimator}.error.position.horizontal",
        code=f"{estimator}.stanford",
        label=ESTIMATORS[estimator],
        role=_ROLES[estimator],
    )
    return Chart(
        id=f"stanford-{estimator}",
        title=f"Stanford, {ESTIMATORS[estimator]}",
        unit="m",
        group="integrity",
        kind="xy",
        across="horizontal error",
        upward="protection level",
        limit="protection.alert",
        regions=REGIONS,
        traces=(cloud,),
        shown=shown,
    )


def _test_chart(test: str, shown: bool = False) -> Chart:
    return chart_of_test(test, capital(TEST_LABELS[test]), f"test.{test}.gps", shown)


def _satellite_chart(id: str, title: str, unit: str, group: str, stem: str) -> Chart:
    """One signal of every satellite; those that are not there have no value and take no room."""
    traces = tuple(Trace(signal=stem.format(n), label=n, item=f"satellite.{n}") for n in SATELLITES)
    return Chart(id=id, title=title, unit=unit, group=group, traces=traces)


def _codes(id: str, title: str, part: str, levels: tuple[str, ...]) -> Chart:
    """One code of every solution, in words."""
    traces = tuple(Trace(signal=f"{e}.{part}", label=label, role=_ROLES[e]) for e, label in ESTIMATORS.items())
    return Chart(id=id, title=title, unit="1", group="integrity", levels=levels, traces=traces)
