"""How large an error could hide in each estimator's set of satellites, and whether one does: the Stanford diagram."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Block, BlockView, Chart, Region, Trace, Wire
from ftcore.detection import protection, raim
from ftcore.estimation.least_squares import Fix
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.systems.base import Flags
from ftcore.systems.gps_receiver import satellites
from ftcore.systems.gps_receiver.estimators import COMBINED, SNAPSHOT
from ftcore.systems.gps_receiver.forms import Settings
from ftcore.systems.reporting import Now

Array = NDArray[np.float64]

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
CLASSES: Final = ("nominal", "misleading", "hazardous", "unavailable")
DECLARED: Final = Declared(
    signals=(
        Signals(
            "{estimator}.protection", "{estimator}: horizontal protection level of its satellites", "m", "integrity"
        ),
        Signals(
            "{estimator}.stanford", "{estimator}: 0 nominal, 1 misleading, 2 hazardously misleading, 3 unavailable",
            "1", "integrity",
        ),
        Signals(
            "protection.horizontal", "horizontal protection level of the combined solution's satellites", "m",
            "integrity",
        ),
        Signals("protection.slope", "the same by slope", "m", "integrity"),
        Signals("protection.separation", "the same by solution separation", "m", "integrity"),
        Signals("protection.alert", "alert limit", "m", "integrity"),
        Signals("detectable.{satellite}", "{satellite}: minimal detectable bias", "m", "integrity"),
    ),
    charts=(
        Chart(
            id="stanford-{estimator}",
            title="Stanford, {estimator}",
            unit="m",
            group="integrity",
            kind="xy",
            across="horizontal error",
            upward="protection level",
            limit="protection.alert",
            regions=REGIONS,
            traces=(
                Trace(
                    signal="{estimator}.protection",
                    across="{estimator}.error.position.horizontal",
                    code="{estimator}.stanford",
                    label="{estimator}",
                ),
            ),
        ),
        Chart(
            id="stanford",
            title="Stanford class of each solution",
            unit="1",
            group="integrity",
            levels=tuple(region.label for region in REGIONS),
            traces=(Trace(signal="{estimator}.stanford", label="{estimator}"),),
        ),
        Chart(
            id="protection",
            title="Protection levels",
            unit="m",
            group="integrity",
            traces=(
                Trace(signal="combined.error.position.horizontal", label="error, combined", role="protected"),
                Trace(signal="protection.slope", label="slope"),
                Trace(signal="protection.separation", label="solution separation"),
                Trace(signal="protection.alert", label="alert limit", role="threshold"),
            ),
        ),
        satellites.chart("detectable", "Minimal detectable bias", "m", "integrity", "detectable.{satellite}"),
    ),
    blocks=(
        Block(
            id="protection", label="Protection", kind="test", x=78, y=36, width=21, height=13,
            settings=("alert_limit", "protection", "missed_detection_probability"),
        ),
    ),
    wires=(Wire(source="combined", target="protection"),),
)  # fmt: skip


@dataclass(frozen=True)
class Protection:
    """Protection of sets of satellites; NaN where nothing is protected.

    ``slope``, ``separation``, ``level`` (runs, sets) [m], the last being the one chosen; ``detectable`` (runs, sets, n)
    minimal detectable biases [m].
    """

    slope: Array
    separation: Array
    level: Array
    detectable: Array


def protect(fix: Fix, sigma: Array, valid: Flags, settings: Settings) -> Protection:
    """Protection of solutions ``fix`` (runs, sets) with ``sigma (runs, n)`` [m]."""
    p_fa, p_md = settings.false_alarm_probability, settings.missed_detection_probability
    if p_fa + p_md >= 1.0:
        p_md = 1.0 - p_fa - 1e-6
    lam = protection.noncentralities(fix.dof, p_fa, p_md)
    steep = protection.slopes(fix.gain, fix.projector, valid)
    slope = protection.slope_level(steep, lam)
    separation = protection.separation_level(steep, fix.gain, fix.covariance, valid, p_fa, p_md)
    separation = np.where(np.isfinite(lam), separation, np.nan)
    return Protection(
        slope=slope,
        separation=separation,
        level=slope if settings.protection == "slope" else separation,
        detectable=protection.minimal_detectable_bias(fix.projector, sigma[:, None], valid, lam),
    )


def report(say: Ledger, p: Protection, alert_limit: float, columns: NDArray[np.intp]) -> None:
    """Protection levels, and the biases of the snapshot's satellites in these ``columns`` that would be found."""
    say["{estimator}.protection"] = p.level
    say["protection.horizontal"] = p.level[:, COMBINED]
    say["protection.slope"] = p.slope[:, COMBINED]
    say["protection.separation"] = p.separation[:, COMBINED]
    say["protection.alert"] = [alert_limit]
    say["detectable.{satellite}", columns] = p.detectable[:, SNAPSHOT]


def classify(say: Ledger) -> None:
    """The Stanford class of each estimator, once its error is known."""
    horizontal = say["{estimator}.error.position.horizontal"]
    declared = (say["{estimator}.status"] <= raim.EXCLUDED) & np.isfinite(horizontal)
    limit = float(say["protection.alert"][0])
    say["{estimator}.stanford"] = protection.stanford(horizontal, say["{estimator}.protection"], limit, declared)


def blocks(now: Now) -> dict[str, BlockView]:
    """The diagram's block of the protection level."""
    if now.said is None or now.health["gps"] == "off":
        return {}
    level, code = float(now.said["protection.horizontal"][0]), int(now.said["{estimator}.stanford"][0, COMBINED])
    text = f"{CLASSES[code]}, {level:.0f} m" if np.isfinite(level) else "no protection"
    return {"protection": BlockView(health="ok" if code == 0 else "suspect", text=text)}
