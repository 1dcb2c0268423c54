"""The redundant IMU: its channels, its place in the scene, and what is said of it."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Chart, Health, SceneItem, Test, Trace
from ftcore.detection.geometry import Cluster
from ftcore.faults import ALL_KINDS
from ftcore.parts import instruments
from ftcore.parts.charts import chart_of_test
from ftcore.parts.declared import Declared, channels_of
from ftcore.parts.instruments import AXES, CLUSTERS
from ftcore.parts.ledger import Ledger
from ftcore.systems.reporting import Now
from ftcore.systems.sins_gps_doppler.imu import ImuEpoch

Array = NDArray[np.float64]


DECLARED: Final = instruments.declared() + Declared(
    channels=tuple(
        channel.model_copy(update={"sensor": f"imu.{cluster}.{axis[0]}"})
        for cluster, (unit, typical) in CLUSTERS.items()
        for axis, channel in zip(
            AXES,
            channels_of(
                f"imu.{cluster}", f"{cluster.capitalize()} {{}}", {axis: axis for axis in AXES},
                sensor=f"imu.{cluster}", unit=unit, kinds=ALL_KINDS, typical=typical,
            ),
            strict=True,
        )
    ),
    tests=(
        Test(
            name="parity-trusted",
            label="parity test of the trusted",
            subjects=("imu.{cluster}",),
            dof="1 while an instrument is out; none while all are trusted",
            source="Kim 2005 (29)-(32)",
            may_drive=False,
            probability="exact",
        ),
    ),
    charts=(
        chart_of_test(
            "parity-trusted-imu.{cluster}",
            "Parity test of the trusted, {cluster}s",
            "test.parity-trusted.imu.{cluster}",
        ),
        Chart(
            id="isolation-{cluster}",
            title="GLT of each {cluster}",
            unit="1",
            group="parity",
            scale="log",
            traces=(Trace(signal="test.glt.imu.{cluster}.{instrument}.statistic", label="{cluster} {instrument}"),),
        ),
    ),
    scene=(
        SceneItem(id="aircraft", label="aircraft", kind="aircraft", frame="level", family="aircraft"),
        *(
            SceneItem(
                id=f"axis.{cluster}.{axis}", label=f"{cluster[0].upper()}{axis}", kind="axis",
                family=f"instrument {axis[0]}", channel=f"imu.{cluster}.{axis}", subject=f"imu.{cluster}.{axis[0]}",
            )
            for cluster in CLUSTERS
            for axis in AXES
        ),
        *(
            item
            for k in (1, 2, 3)
            for item in (
                SceneItem(id=f"spin.{k}", label=f"spin {k}", kind="spin", family=f"instrument {k}"),
                SceneItem(id=f"plane.{k}", label=f"fault plane {k}", kind="plane", family=f"instrument {k}"),
            )
        ),
        SceneItem(id="parity.{cluster}", label="{cluster} parity", kind="vector", family="parity vector"),
    ),
)  # fmt: skip


def report(say: Ledger, imu: ImuEpoch) -> None:
    """Parity space, the test of the trusted, and who is out and used."""
    instruments.report(say, imu.sight, imu.found, imu.parity)
    tested, rest = imu.rest.dof > 0, imu.rest
    statistic, threshold = (np.where(tested, v, np.nan) for v in (rest.statistic, rest.threshold))
    say.test("parity-trusted", "imu.{cluster}", statistic, threshold, rest.dof, rest.alarm)
    say.judge("imu.{cluster}.{instrument}", imu.decision.health.reshape(imu.used.shape), imu.used)
    say["used.imu.{cluster}.{instrument}"] = imu.used
    # With one instrument left there is no parity: no threshold, and nothing to draw.
    seen = imu.sight.dof > 0
    square = np.divide(imu.sight.FD, imu.sight.threshold, out=np.zeros_like(imu.sight.FD), where=seen)
    ratio = np.sqrt(square.reshape(-1, len(CLUSTERS))[0])
    p = imu.parity[0]
    length = np.maximum(np.linalg.norm(p, axis=-1), 1e-30)
    say.draw("parity.{cluster}", p / length[:, None] * np.minimum(ratio, 2.0)[:, None])


def vectors(cluster: Cluster) -> dict[str, Array]:
    """Scene items that never change: axes, spins, fault planes."""
    axes = {
        f"axis.{name}.{axis}": instruments.LENGTH[name] * cluster.H[i]
        for name in CLUSTERS
        for i, axis in enumerate(AXES)
    }
    return axes | instruments.spins_and_planes(cluster)


def items(now: Now) -> dict[str, Health]:
    """A parity vector is marked while its cluster's parity test alarms."""
    if now.said is None:
        return {}
    alarm = now.said.of_test("parity", "imu.{cluster}", "alarm")[0] > 0.0
    return {f"parity.{name}": "suspect" if a else "ok" for name, a in zip(CLUSTERS, alarm, strict=True)}
