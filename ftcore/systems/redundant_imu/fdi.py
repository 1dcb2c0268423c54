"""Parity space on the gyros of one aircraft: four tests beside each other, one of which declares.

Kim 2005, section 4.1: FD on the squared parity vector, FI by its angle to the fault planes; beside them the distance
from the planes as a statistic, the GLT and the optimal parity vector.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Block, BlockView, Chart, Health, Probability, Test, Trace, Wire
from ftcore.detection import chi_square, parity
from ftcore.detection.geometry import Cluster
from ftcore.detection.parity import Isolation, Reference, Sight
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.systems.base import Flags
from ftcore.systems.redundant_imu.forms import Settings
from ftcore.systems.redundant_imu.gyros import GYRO, SUBJECTS, Geometry
from ftcore.systems.reporting import Now

Array = NDArray[np.float64]


def chart(test: str, title: str, unit: str, scale: str) -> Chart:
    """A test's statistic of all three gyros, and the threshold they share."""
    return Chart(
        id=test,
        title=title,
        unit=unit,
        group="tests",
        scale=scale,  # type: ignore[arg-type]
        traces=(
            Trace(signal=f"test.{test}.imu.gyro.{{gyro}}.statistic", label="{gyro}", role="statistic"),
            Trace(signal=f"test.{test}.{SUBJECTS[0]}.threshold", label="threshold", role="threshold"),
        ),
    )


def _of_all(id: str, title: str, test: str, threshold: str) -> Chart:
    stem = f"test.{test}.{GYRO}"
    return Chart(
        id=id,
        title=title,
        unit="1",
        group="tests",
        scale="log",
        traces=(
            Trace(signal=f"{stem}.statistic", label="FD / sigma²", role="statistic"),
            Trace(signal=f"{stem}.threshold", label=threshold, role="threshold"),
        ),
    )


def _test(name: str, label: str, dof: str, source: str, probability: Probability, note: str = "") -> Test:
    whole = name.startswith("parity")
    return Test(
        name=name,
        label=label,
        subjects=(GYRO,) if whole else ("imu.gyro.{gyro}",),
        dof=dof,
        source=source,
        may_drive=not whole,
        unit="deg" if name == "isolation-angle" else "1",
        alarm_when="below" if name in ("isolation-angle", "fault-plane") else "above",
        probability=probability,
        probability_note=note,
    )


_SETTINGS: Final = ("driving_test", "false_alarm_probability", "angle_threshold")
DECLARED: Final = Declared(
    members={"component": {str(i): str(i) for i in (1, 2, 3)}},
    tests=(
        _test("parity", "fault detection FD", "3", "Kim 2005 (29)-(32)", "exact"),
        _test(
            "parity-trusted", "FD of the trusted gyros", "3 with all gyros, 1 with two", "Kim 2005 (29)-(32)", "exact"
        ),
        _test(
            "isolation-angle", "isolation angle FI", "an angle, not a statistic", "Kim 2005 section 4.1", "bounded",
            "a gyro alarms only where FD does and points at it, at a quarter of the stated probability",
        ),
        _test(
            "fault-plane", "distance from the fault plane", "1", "FTLab: the angle as a statistic", "bounded",
            "a gyro alarms only where FD does and points at it, at 0.5 to 0.9 of the stated probability",
        ),
        _test(
            "glt", "GLT", "1", "Daly, Gai and Harrison", "bounded",
            "a gyro alarms only where FD does and no other explains it as well, at 0.06 of the stated probability",
        ),
        _test(
            "optimal-parity", "optimal parity vector", "2", "Jin and Zhang, for two axes", "bounded",
            "a gyro alarms only where no other explains it as well, at 0.06 of the stated probability",
        ),
    ),
    signals=(Signals("parity.{component}", "parity vector {component}", "rad/s", "parity"),),
    charts=(
        _of_all("detection", "Fault detection FD (figure 5)", "parity", "T_D / sigma²"),
        chart("isolation-angle", "Fault isolation FI (figure 6)", "deg", "linear"),
        Chart(
            id="parity-vector",
            title="Parity vector",
            unit="rad/s",
            group="parity",
            traces=(Trace(signal="parity.{component}", label="component {component}"),),
        ),
        _of_all("parity-trusted", "FD of the trusted gyros", "parity-trusted", "threshold"),
        chart("fault-plane", "Distance from the fault planes", "1", "log"),
        chart("glt", "GLT", "1", "log"),
        chart("optimal-parity", "Optimal parity vector", "1", "log"),
    ),
    blocks=(
        Block(id="detection", label="Detection", kind="test", x=26, y=2, width=23, height=12, settings=_SETTINGS),
        Block(id="isolation", label="Isolation", kind="test", x=26, y=19, width=23, height=12, settings=_SETTINGS),
    ),
    wires=(
        Wire(source="detection", target="isolation"),
        Wire(source="isolation", target="ukf"),
        Wire(source="isolation", target="supervisor"),
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """What parity space says at one epoch.

    Attributes:
        p: ``(runs, 3)`` parity vector of all gyros that read [rad/s].
        detected: ``(runs,)`` the gyros that are still trusted disagree.
        declared: ``(runs, 3)`` who of them is held for faulty; several where it cannot be told.
        spare: ``(runs, 3)`` where several are declared, the one of those that read, isolated or not, without which the
            other two agree best; nobody where two choices are alike but for the noise, or where fewer than three read.
        whole, rest: what was seen of all that read, and of those that are trusted.
        instruments: test -> what it says of every gyro, and whom it names ``(runs, 3)``.
    """

    p: Array
    detected: Flags
    declared: Flags
    spare: Flags
    whole: Sight
    rest: Sight
    instruments: Mapping[str, tuple[Isolation, Flags]]


def reference(cluster: Cluster, noise: float) -> Reference:
    """A healthy cluster whose axes have white noise [rad/s] and no biases, as Kim 2005 has it."""
    return parity.uncalibrated(cluster, noise, 0.0)


def judge(expected: Reference, m: Array, reading: Flags, trusted: Flags, settings: Settings) -> Verdict:
    """Test readings ``m (runs, 6)`` of the gyros that read, and among them those still trusted, ``(runs, 3)`` each.

    The tests that are shown judge all that read, so that a fault stays in sight after it was isolated. GLT and optimal
    parity vector name nobody where two explain the parity vector equally well: they declare both. With a gyro out a
    single degree of freedom is left: another fault is detected, but every gyro that is left explains it equally, so
    all of them are declared. So they are when the parity vector lies in nobody's plane.
    """
    p_fa = settings.false_alarm_probability
    whole = rest = parity.look(expected, m, p_fa, reading)
    angle = parity.by_angle(whole, math.radians(settings.angle_threshold))
    plane = parity.by_plane(whole)
    glt = parity.by_likelihood(whole)
    optimal = parity.by_optimal_vector(whole)
    near, close = angle.extra["candidate"], plane.extra["candidate"]
    # Whoever explains the parity vector as well as the best does, within what noise does, is as guilty.
    explained = glt.extra["explained"]
    level = explained >= explained.max(axis=-1, keepdims=True) - chi_square.threshold(p_fa, 1)
    alone = level.sum(axis=-1, keepdims=True) == 1
    driver = {
        "isolation-angle": near,
        "fault-plane": close,
        "glt": np.where(alone, glt.alarm, level),
        "optimal-parity": np.where(alone, optimal.alarm, level),
    }
    declared: Flags = np.zeros(near.shape, bool)
    fewer = (trusted != reading).any(axis=-1)
    if fewer.any():
        rest = parity.look(expected, m, p_fa, trusted)
    if settings.driving_test != "none":
        declared = driver[settings.driving_test] & ~fewer[:, None]
        declared = (declared | ~declared.any(axis=-1, keepdims=True)) & trusted & rest.alarm[:, None]
    several = declared.sum(axis=-1, keepdims=True) > 1
    least = whole.outside <= whole.outside.min(axis=-1, keepdims=True) + chi_square.threshold(p_fa, 1)
    spare = least & (least.sum(axis=-1, keepdims=True) == 1) & several & reading.all(axis=-1, keepdims=True)
    return Verdict(
        p=whole.p,
        detected=rest.alarm,
        declared=declared,
        spare=spare,
        whole=whole,
        rest=rest,
        instruments={
            "isolation-angle": (angle, near),
            "fault-plane": (plane, close),
            "glt": (glt, glt.alarm & alone),
            "optimal-parity": (optimal, optimal.alarm & alone),
        },
    )


def report(say: Ledger, verdict: Verdict) -> None:
    """All tests of parity space, and the parity vector."""
    say["parity.{component}"] = verdict.p
    for name, of_all in (("parity", verdict.whole), ("parity-trusted", verdict.rest)):
        tell(say, name, GYRO, of_all.FD, of_all.threshold, of_all.dof, of_all.alarm)
    for name, (test, alarm) in verdict.instruments.items():
        tell(say, name, "imu.gyro.{gyro}", test.statistic, test.threshold, test.dof, alarm)
    ratio = math.sqrt(verdict.whole.FD[0] / max(float(verdict.whole.threshold[0]), 1e-30))
    length = max(float(np.linalg.norm(verdict.p[0])), 1e-30)
    say.draw("parity", verdict.p[0] / length * min(ratio, 1.6))


def tell(say: Ledger, test: str, subject: str, statistic: Array, threshold: Array, dof: Any, alarm: Flags) -> None:
    """Write a test; its statistic is no number where nothing was judged."""
    say.test(test, subject, np.where(dof > 0, statistic, np.nan), threshold, dof, alarm)


def blocks(now: Now, geometry: Geometry) -> dict[str, BlockView]:
    """The diagram's blocks of detection and isolation."""
    if now.said is None:
        share = geometry.ambiguous_share(now.controls.settings.angle_threshold)
        return {"isolation": BlockView(health="ok", text=f"{100.0 * share:.0f} % of faults ambiguous")}
    of_test = now.said.of_test
    FD, limit = of_test("parity", GYRO, "statistic")[0], of_test("parity", GYRO, "threshold")[0]
    detected = of_test("parity", GYRO, "alarm")[0] > 0.0
    angles = of_test("isolation-angle", "imu.gyro.{gyro}", "statistic")[0]
    named = of_test("isolation-angle", "imu.gyro.{gyro}", "alarm")[0] > 0.0
    text = " ".join(f"{math.degrees(v):.0f}°" if np.isfinite(v) else "–" for v in angles)
    ratio = np.nan_to_num(FD) / max(float(limit), 1e-30)
    return {
        "detection": BlockView(health="suspect" if detected else "ok", text=f"FD at {ratio:.2f} of T_D"),
        "isolation": BlockView(health="suspect" if named.any() else "ok", text=f"FI {text}"),
    }


def items(now: Now) -> dict[str, Health]:
    """A fault plane is marked while the angle test declares its gyro, the parity vector while there is an alarm."""
    if now.said is None:
        return {}
    named = now.said.of_test("isolation-angle", "imu.gyro.{gyro}", "alarm")[0] > 0.0
    planes = {f"plane.{k + 1}": subject for k, subject in enumerate(SUBJECTS)}
    found: dict[str, Health] = {}
    for k, (plane, subject) in enumerate(planes.items()):
        out = now.health[subject] in ("isolated", "off")
        found[plane] = now.health[subject] if out else "suspect" if named[k] else "ok"
    return found | {"parity": "suspect" if now.said.of_test("parity", GYRO, "alarm")[0] else "ok"}
