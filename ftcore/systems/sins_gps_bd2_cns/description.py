"""How the SINS/GPS/BD2/CNS system describes itself: channels, tests, signals, charts, diagram, scene."""

from __future__ import annotations

from functools import lru_cache

from ftcore.description import Channel, Signal, Subsystem, SystemDescription, Test, with_probabilities
from ftcore.faults import ALL_KINDS
from ftcore.systems.declarations import (
    declared_imu_tests,
    flight_signals,
    navigation_signals,
    parity_signals,
    signals_of_tests,
    used_signals,
)
from ftcore.systems.sins_gps_bd2_cns.charts import charts
from ftcore.systems.sins_gps_bd2_cns.forms import Parameters, Settings
from ftcore.systems.sins_gps_bd2_cns.names import (
    AIDS,
    AXES,
    BODY,
    EPOCH,
    ERRORS,
    ESTIMATORS,
    MODELS,
    SUBJECTS,
    SUBSET_LABELS,
    SUBSETS,
    TEST_LABELS,
    TESTS,
    subject_label,
)
from ftcore.systems.sins_gps_bd2_cns.pictures import blocks, scene, wires

_AID_PARTS = {
    "gps": ("position", "m", ("east", "north", "up"), 12.0),
    "bd2": ("position", "m", ("east", "north", "up"), 12.0),
    "cns": ("attitude", "arcsec", ("roll", "pitch", "heading"), 20.0),
}


def _channels() -> list[Channel]:
    found = []
    for sensor, (quantity, unit, parts, typical) in _AID_PARTS.items():
        name = AIDS[sensor]
        for i, part in enumerate(parts):
            found.append(_channel(sensor, sensor, quantity, part, f"{name} {part}", unit, (i,), typical))
        what = "all axes" if quantity == "position" else "all angles"
        found.append(_channel(sensor, sensor, quantity, "all", f"{name} {quantity}, {what}", unit, (0, 1, 2), typical))
    for cluster, unit, typical in (("gyro", "deg/h", 20.0), ("accelerometer", "mg", 1.0)):
        name = cluster.capitalize()
        group = f"imu.{cluster}"
        for i, axis in enumerate(AXES):
            sensor = group if axis in BODY else f"{group}.{axis[0]}"
            label = f"{name} {axis}" if axis in BODY else f"{name} {axis} (redundant IMU)"
            found.append(_channel(sensor, "imu", cluster, axis, label, unit, (i,), typical))
        everything = tuple(range(len(AXES)))
        found.append(_channel(group, "imu", cluster, "all", f"{name}, all axes", unit, everything, typical))
    return found


def _channel(
    sensor: str, prefix: str, quantity: str, part: str, label: str, unit: str, parts: tuple[int, ...], typical: float
) -> Channel:
    return Channel(
        name=f"{prefix}.{quantity}.{part}",
        label=label,
        unit=unit,
        sensor=sensor,
        group=f"{prefix}.{quantity}",
        parts=parts,
        kinds=ALL_KINDS,
        typical=typical,
    )


def _tests() -> list[Test]:
    rows = (
        ("two-propagator", "readings of the aid, 3", "Yang 2016 (12)-(13), innovation form", True, "TODO"),
        ("two-propagator-state", "directions learned, up to 3", "Yang 2016 (12)-(13), state form", True, "TODO"),
        ("two-propagator-without-imm", "readings of the aid, 3", "Yang 2016 [20], innovation form", False, "TODO"),
    )
    found = [
        Test(
            name=n,
            label=TEST_LABELS[n],
            subjects=tuple(AIDS),
            dof=dof,
            source=source,
            may_drive=drives,
            baseline=not drives,
            reference=("imu",),
            probability="approximate",
            probability_note=note,
        )
        for n, dof, source, drives, note in rows
    ]
    found += declared_imu_tests(TEST_LABELS, TESTS, unless="without the redundant IMU")
    return found


def _signals() -> list[Signal]:
    found = navigation_signals(ESTIMATORS, ERRORS) + signals_of_tests(TESTS, TEST_LABELS, subject_label)
    for aid, label in AIDS.items():
        words = f"two-propagator test, {label}: lower threshold, doubt"
        found.append(Signal(name=f"test.two-propagator.{aid}.doubt", label=words, unit="1", group="test"))
    for aid, label in AIDS.items():
        found.append(Signal(name=f"validity.{aid}", label=f"validity of {label}", unit="1", group="weight"))
    for name, label in zip(SUBSETS, SUBSET_LABELS, strict=True):
        found.append(Signal(name=f"weight.{name}", label=f"weight of {label}", unit="1", group="weight"))
    for model in MODELS:
        found.append(Signal(name=f"probability.{model}", label=f"probability of Q {model}", unit="1", group="weight"))
    found.append(Signal(name="propagator.reference", label="which propagator is the reference", unit="1", group="test"))
    for which in ("1", "2", "reference"):
        words = "the reference propagator" if which == "reference" else f"propagator {which}"
        found.append(Signal(name=f"propagator.{which}.age", label=f"age of {words}", unit="s", group="test"))
    found += used_signals(SUBJECTS, subject_label)
    found += parity_signals()
    return found + flight_signals()


@lru_cache(maxsize=1)
def description() -> SystemDescription:
    """The whole description."""
    tests = tuple(_tests())
    return SystemDescription(
        id="sins-gps-bd2-cns",
        title="SINS/GPS/BD2/CNS with IMM and tolerant fusion",
        summary=(
            "A strapdown inertial system aided by two satellite systems and a star tracker, over an hour of high and "
            "low manoeuvre. Two alternating propagators test every aid, an interacting multiple model adapts to the "
            "manoeuvre, and eight subsets of aids are fused by how much each aid may be believed."
        ),
        source=(
            "C. Yang, A. Mohammadi and Q.-W. Chen, Multi-sensor fusion with interaction multiple model and chi-square "
            "test tolerant filter, Sensors 16 (2016) 1835"
        ),
        epoch=EPOCH,
        channels=tuple(_channels()),
        subsystems=tuple(Subsystem(name=name, label=label) for name, label in AIDS.items()),
        estimators=ESTIMATORS,
        tests=tests,
        signals=tuple(_signals()),
        charts=with_probabilities(tuple(charts()), tests),
        blocks=tuple(blocks()),
        wires=tuple(wires()),
        scene=tuple(scene()),
        settings_schema=Settings.model_json_schema(),
        parameters_schema=Parameters.model_json_schema(),
        score_headline=("fused.error.position.horizontal", "unprotected.error.position.horizontal"),
        score_label="Worst horizontal error",
    )
