"""What the mounting of redundant instruments is good for, as figures: known before anything flies."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Band, Indicator, IndicatorMap
from ftcore.detection import ambiguity, geometry, parity
from ftcore.detection.geometry import Cluster
from ftcore.detection.parity import Reference
from ftcore.detection.protection import noncentrality

FDI_IDEAL = 4.0
"""Largest J_FDI of three 2-DOF instruments: Kim 2005, section 3."""
GNC_IDEAL = 1.0 / math.sqrt(8.0)
"""Least J_GNC of six axes: (7) with (24), H'H = 2 I."""
MISSED = 0.01
"""Probability with which the least fault is missed in an epoch."""


def mounting_indicators(cluster: Cluster, field: str) -> tuple[Indicator, ...]:
    """Indices of three 2-DOF instruments, and how far apart they show a fault. ``field``: path of the angles."""
    return (
        Indicator(
            id="fdi",
            label="J_FDI, isolation",
            value=float(geometry.fdi_index(cluster.H)),
            unit="1",
            ideal=FDI_IDEAL,
            better="higher",
            field=field,
            note="How much more the parity equation of an axis feels that axis than any other, for the worst axis; "
            "Kim 2005 (16).",
        ),
        Indicator(
            id="gnc",
            label="J_GNC, navigation",
            value=float(geometry.gnc_index(cluster.H)),
            unit="1",
            ideal=GNC_IDEAL,
            better="lower",
            field=field,
            note="Volume of the error of the solved rates; with spin axes at right angles it is ideal at any mounting "
            "angles; Kim 2005 (7), (26).",
        ),
        Indicator(
            id="axis-margin",
            label="A single axis' fault: to the next plane",
            value=math.degrees(float(_axis_margin(cluster))),
            unit="deg",
            ideal=45.0,
            better="higher",
            field=field,
            note="Least angle from the parity vector of a fault of one axis to another instrument's fault plane: below "
            "the angle threshold such a fault cannot be placed.",
        ),
        Indicator(
            id="planes",
            label="Between fault planes",
            value=math.degrees(float(geometry.plane_angles(cluster).min())),
            unit="deg",
            ideal=90.0,
            better="higher",
            field=field,
            note="Least angle between two instruments' fault planes; with spin axes at right angles the planes are at "
            "right angles too, at any mounting angles.",
        ),
    )


def _axis_margin(cluster: Cluster) -> NDArray[np.float64]:
    """Least angle [rad] of any axis' column of V to the fault plane of an instrument that it does not belong to."""
    FI = parity.fault_angles(parity.uncalibrated(cluster, 1.0, 0.0), cluster.V.T)
    others = cluster.instrument[:, None] != np.arange(cluster.count)
    return np.asarray(FI[others].min())


def detection_indicator(reference: Reference, p_fa: float, unit: str, field: str) -> Indicator:
    """The least bias of one axis, of the worst, that FD sees in the epoch it comes in, save with :data:`MISSED`."""
    # A bias moves the whitened parity vector by sensitivity times bias; squared that is the noncentrality.
    least = math.sqrt(noncentrality(int(reference.dof[0]), p_fa, MISSED)) / float(reference.sensitivity[0].min())
    return Indicator(
        id="least-fault",
        label="Least fault seen at once",
        value=least,
        unit=unit,
        better="lower",
        field=field,
        note=f"Bias of one axis that FD detects in its first epoch with probability {1.0 - MISSED:.0%}: from the "
        "noncentral chi-square distribution.",
    )


def ambiguity_indicators(reference: Reference, limit: float, field: str, label: str) -> tuple[Indicator, ...]:
    """Which faults of each two-axis instrument the angle test cannot place at a threshold ``limit`` [rad].

    ``label`` names the instruments: "gyro" for "gyro 1".
    """
    found = []
    degrees = math.degrees(limit)
    for k, bands in enumerate(ambiguity.ambiguous_bands(reference, limit)):
        covered = _length([(start, end) for start, end, _ in bands])
        found.append(
            Indicator(
                id=f"ambiguous.{k + 1}",
                label=f"Ambiguous faults of {label} {k + 1}",
                value=100.0 * covered / math.pi,
                unit="%",
                ideal=0.0,
                better="lower",
                field=field,
                note=f"Share of the directions of a fault in which the parity vector is within {degrees:g}° of another "
                f"{label}'s fault plane too, noise aside: parity space alone declares both; Kim 2005 section 4.1.",
                map=IndicatorMap(
                    label="direction of the fault, from the first input axis over the second",
                    unit="deg",
                    low=0.0,
                    high=180.0,
                    bands=tuple(
                        Band(start=math.degrees(start), end=math.degrees(end), label=f"{label} {other + 1}")
                        for start, end, other in bands
                    ),
                ),
            )
        )
    return tuple(found)


def _length(intervals: list[tuple[float, float]]) -> float:
    """Length of the union of intervals."""
    edges: NDArray[np.float64] = np.array(sorted(intervals)).reshape(-1, 2)
    if not len(edges):
        return 0.0
    reached = np.maximum.accumulate(edges[:, 1])
    begins = np.maximum(edges[:, 0], np.concatenate([[-np.inf], reached[:-1]]))
    return float(np.maximum(edges[:, 1] - begins, 0.0).sum())
