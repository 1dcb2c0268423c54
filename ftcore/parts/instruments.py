"""Three 2-DOF gyros and three 2-DOF accelerometers: how they are called, and what parity space says of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Chart, Test, Trace
from ftcore.detection.geometry import Cluster
from ftcore.detection.parity import Isolation, Sight
from ftcore.parts.charts import chart_of_test
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger

Array = NDArray[np.float64]

CLUSTERS: Final = {"gyro": ("deg/h", 20.0), "accelerometer": ("mg", 1.0)}
"""Instruments of one kind -> the unit in which a person reads them, and a fault worth trying first."""
LENGTH: Final = {"gyro": 1.0, "accelerometer": 0.65}
"""Of an axis in the scene."""
AXES: Final = ("1x", "1y", "2x", "2y", "3x", "3y")
PARITY_TESTS: Final = {"parity": ("parity test", "Kim 2005 (29)-(32)"), "glt": ("GLT", "Zhang 1992 [12]")}


def declared(unless: str | None = None, whose: str = "") -> Declared:
    """Parity test and GLT of each cluster and instrument, and the parity vectors.

    Args:
        unless: when they say nothing, in words.
        whose: what the titles of the charts add.
    """
    silent = "" if unless is None else f"; none {unless}"
    return Declared(
        members={
            "cluster": {name: name for name in CLUSTERS},
            "instrument": {str(k): str(k) for k in (1, 2, 3)},
            "component": {str(i): str(i) for i in (1, 2, 3)},
        },
        subjects={"imu.{cluster}.{instrument}": "{cluster} {instrument}"},
        wholes={"imu.{cluster}": "{cluster}s"},
        tests=tuple(
            Test(
                name=name,
                label=label,
                subjects=("imu.{cluster}", "imu.{cluster}.{instrument}"),
                dof=f"3 for the whole; 1 for an instrument{silent}",
                source=source,
                probability="exact",
                probability_note="an instrument alarms only where the whole does and names it, at a third of the "
                "stated probability",
            )
            for name, (label, source) in PARITY_TESTS.items()
        ),
        signals=(
            *(
                Signals(f"parity.{cluster}.{{component}}", f"{cluster} parity vector {{component}}", unit, "parity")
                for cluster, (unit, _) in CLUSTERS.items()
            ),
            Signals("used.imu.{cluster}.{instrument}", "{cluster} {instrument} used", "1", "decision"),
        ),
        charts=(
            *(
                chart_of_test(f"{name}-imu.{{cluster}}", f"{label}, {{cluster}}s", f"test.{name}.imu.{{cluster}}")
                for name, (label, _) in PARITY_TESTS.items()
            ),
            *(
                Chart(
                    id=f"parity-vector-{cluster}",
                    title=f"Parity vector, {cluster}s{whose}",
                    unit=unit,
                    group="parity",
                    traces=(Trace(signal=f"parity.{cluster}.{{component}}", label="component {component}"),),
                )
                for cluster, (unit, _) in CLUSTERS.items()
            ),
        ),
    )


def report(say: Ledger, sight: Sight, found: Mapping[str, Isolation], p: Array) -> None:
    """What parity space saw: rows are runs times clusters.

    Args:
        sight: of all instruments that read.
        found: test -> what it says of each instrument.
        p: ``(runs, 2, 3)`` parity vectors [SI].
    """
    shape = (say.runs, len(CLUSTERS))

    def tell(test: str, subject: str, statistic: Any, threshold: Any, dof: Any, alarm: Any, shape: Any) -> None:
        statistic, threshold, dof, alarm = (np.reshape(v, shape) for v in (statistic, threshold, dof, alarm))
        tested = dof > 0  # a test without a reading has no statistic: a gap, not a zero
        say.test(test, subject, np.where(tested, statistic, np.nan), np.where(tested, threshold, np.nan), dof, alarm)

    for test, each in found.items():
        tell(test, "imu.{cluster}", sight.FD, sight.threshold, sight.dof, sight.alarm, shape)
        tell(test, "imu.{cluster}.{instrument}", each.statistic, each.threshold, each.dof, each.alarm, (*shape, 3))
    for c, cluster in enumerate(CLUSTERS):
        say[f"parity.{cluster}.{{component}}"] = p[:, c]


def spins_and_planes(cluster: Cluster) -> dict[str, Array]:
    """Scene items of three 2-DOF instruments.

    ``spin.<k>`` is across the two axes of each; ``plane.<k>`` is the normal of its fault plane in parity space.
    """
    axes, columns = cluster.H.reshape(3, 2, 3), cluster.V.T.reshape(3, 2, 3)
    spins, normals = np.cross(axes[:, 0], axes[:, 1]), np.cross(columns[:, 0], columns[:, 1])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return {f"spin.{k + 1}": 0.8 * spins[k] for k in range(3)} | {f"plane.{k + 1}": normals[k] for k in range(3)}
