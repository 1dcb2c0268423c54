"""Signals, tests and charts that several systems declare alike: one number is called, and shown, alike in all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from ftcore.description import Chart, Signal, Test, Trace

CLUSTERS = {"gyro": "deg/h", "accelerometer": "mg"}
"""Instruments of an inertial unit, and the unit in which a person reads their parity vector."""
OF_TEST = ("statistic", "threshold", "dof", "alarm")
"""What is recorded of every test, in column order."""


def redundant_imu_tests(names: Sequence[str]) -> list[tuple[str, str]]:
    """(test, subject) of these tests on three 2-DOF gyros and three 2-DOF accelerometers, in column order."""
    return [
        (test, subject)
        for test in names
        for cluster in CLUSTERS
        for subject in (f"imu.{cluster}", *(f"imu.{cluster}.{k}" for k in (1, 2, 3)))
    ]


def declared_imu_tests(
    labels: Mapping[str, str], tests: Sequence[tuple[str, str]], unless: str | None = None
) -> list[Test]:
    """Parity test and GLT of a redundant IMU. ``unless``: when they say nothing, in words."""
    silent = "" if unless is None else f"; none {unless}"
    return [
        Test(
            name=name,
            label=labels[name],
            subjects=tuple(subject for test, subject in tests if test == name),
            dof=f"3 for the whole; 1 for an instrument{silent}",
            source=source,
            probability="exact",
            probability_note="an instrument alarms only where the whole does and names it, at a third of the stated "
            "probability",
        )
        for name, source in (("parity", "Kim 2005 (29)-(32)"), ("glt", "Zhang 1992 [12]"))
    ]


def navigation_signals(
    estimators: Mapping[str, str], errors: Mapping[str, tuple[str, tuple[str, ...]]]
) -> list[Signal]:
    """Errors, 1-sigma, horizontal error and NEES of every estimator (name -> label). ``errors``: quantity -> unit,
    parts. Values in this order: :func:`ftcore.systems.reporting.navigation_columns`."""
    found = []
    for estimator, label in estimators.items():
        for kind, words in (("error", "error"), ("sigma", "1-sigma")):
            for quantity, (unit, parts) in errors.items():
                for part in parts:
                    name = f"{estimator}.{kind}.{quantity}.{part}"
                    found.append(Signal(name=name, label=f"{label}: {quantity} {part} {words}", unit=unit, group=kind))
        horizontal = f"{estimator}.error.position.horizontal"
        found.append(Signal(name=horizontal, label=f"{label}: horizontal position error", unit="m", group="error"))
        found.append(Signal(name=f"{estimator}.nees", label=f"{label}: NEES, 9 states", unit="1", group="consistency"))
    return found


def signals_of_tests(
    tests: Sequence[tuple[str, str]],
    labels: Mapping[str, str],
    subject_label: Callable[[str], str],
    units: Mapping[str, str] | None = None,
) -> list[Signal]:
    """What is recorded of every (test, subject). ``units``: of statistic and threshold, where they have one."""
    return [
        Signal(
            name=f"test.{test}.{subject}.{part}",
            label=f"{labels[test]}, {subject_label(subject)}: {part}",
            unit=(units or {}).get(test, "1") if part in OF_TEST[:2] else "1",
            group="test",
        )
        for test, subject in tests
        for part in OF_TEST
    ]


def parity_signals() -> list[Signal]:
    """Parity vectors of gyros and accelerometers."""
    return [
        Signal(name=f"parity.{cluster}.{i}", label=f"{cluster} parity vector {i}", unit=unit, group="parity")
        for cluster, unit in CLUSTERS.items()
        for i in (1, 2, 3)
    ]


def used_signals(subjects: Sequence[str], subject_label: Callable[[str], str]) -> list[Signal]:
    """Whether the master uses each subject."""
    return [Signal(name=f"used.{s}", label=f"{subject_label(s)} used", unit="1", group="decision") for s in subjects]


def flight_signals() -> list[Signal]:
    """What is really flown. Values in this order: :func:`ftcore.systems.reporting.flight_columns`."""
    rows = (
        ("height", "height", "m"),
        ("speed", "ground speed", "m/s"),
        ("roll", "roll", "deg"),
        ("pitch", "pitch", "deg"),
        ("heading", "heading", "deg"),
    )
    return [
        Signal(name=f"truth.{name}", label=f"true {words}", unit=unit, group="flight") for name, words, unit in rows
    ]


def parity_charts(whose: str = "") -> list[Chart]:
    """Parity vector of the gyros, and of the accelerometers. ``whose``: what the title adds."""
    return [
        Chart(
            id=f"parity-vector-{cluster}",
            title=f"Parity vector, {cluster}s{whose}",
            unit=unit,
            group="parity",
            traces=tuple(Trace(signal=f"parity.{cluster}.{i}", label=f"component {i}") for i in (1, 2, 3)),
        )
        for cluster, unit in CLUSTERS.items()
    ]


def nees_chart(estimators: Mapping[str, str], roles: Mapping[str, str]) -> Chart:
    """Consistency of these estimators (name -> label)."""
    return Chart(
        id="nees",
        title="Consistency: NEES of 9 states",
        unit="1",
        group="consistency",
        scale="log",
        traces=tuple(
            Trace(signal=f"{e}.nees", label=label, role=roles[e])  # type: ignore[arg-type]
            for e, label in estimators.items()
        ),
    )


def chart_of_test(id: str, title: str, stem: str, shown: bool = False) -> Chart:
    """A test's statistic and its threshold; ``stem``: ``test.<test>.<subject>``."""
    return Chart(
        id=id,
        title=title,
        unit="1",
        group="tests",
        scale="log",
        traces=(
            Trace(signal=f"{stem}.statistic", label="statistic", role="statistic"),
            Trace(signal=f"{stem}.threshold", label="threshold", role="threshold"),
        ),
        shown=shown,
    )


def capital(words: str) -> str:
    """The first letter large, the others as they are."""
    return words[:1].upper() + words[1:]
