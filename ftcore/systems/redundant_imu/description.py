"""How the redundant-IMU system describes itself: channels, tests, signals, charts, diagram, scene."""

from __future__ import annotations

from functools import lru_cache

from ftcore.description import (
    Channel,
    Probability,
    Signal,
    Subsystem,
    SystemDescription,
    Test,
    with_probabilities,
)
from ftcore.faults import ALL_KINDS
from ftcore.systems.declarations import signals_of_tests, used_signals
from ftcore.systems.redundant_imu.charts import charts
from ftcore.systems.redundant_imu.forms import Parameters, Settings
from ftcore.systems.redundant_imu.names import (
    AIR,
    AIRCRAFT,
    AXES,
    EPOCH,
    ERRORS,
    ESTIMATORS,
    FLOWN,
    FLOWN_LABELS,
    GYRO,
    HEALTHY,
    SUBJECTS,
    TEST_LABELS,
    TESTS,
    subject_label,
)
from ftcore.systems.redundant_imu.pictures import blocks, scene, wires

RECOVERY = 2.0
"""Seconds for which a fault may still show after its end: a gyro is back after half a second of agreement."""

# label, unit, fault worth trying first
_AIR = {
    "speed": ("Airspeed", "m/s", 10.0),
    "alpha": ("Angle of attack", "deg", 3.0),
    "beta": ("Angle of sideslip", "deg", 3.0),
    "height": ("Height", "m", 30.0),
}
# Degrees of freedom, source, what the false-alarm probability is.
_OF_TEST: dict[str, tuple[str, str, Probability]] = {
    "parity": ("3", "Kim 2005 (29)-(32)", "exact"),
    "parity-trusted": ("3 with all gyros, 1 with two", "Kim 2005 (29)-(32)", "exact"),
    "isolation-angle": ("an angle, not a statistic", "Kim 2005 section 4.1", "bounded"),
    "fault-plane": ("1", "FTLab: the angle as a statistic", "bounded"),
    "glt": ("1", "Daly, Gai and Harrison", "bounded"),
    "optimal-parity": ("2", "Jin and Zhang, for two axes", "bounded"),
    "ukf": ("2", "Kim 2005 (48)-(49)", "approximate"),
}

_NOTES = {
    "isolation-angle": "a gyro alarms only where FD does and points at it, at a quarter of the stated probability",
    "fault-plane": "a gyro alarms only where FD does and points at it, at 0.5 to 0.9 of the stated probability",
    "glt": "a gyro alarms only where FD does and no other explains it as well, at 0.06 of the stated probability",
    "optimal-parity": "a gyro alarms only where no other explains it as well, at 0.06 of the stated probability",
    "ukf": "it runs after an alarm only, and its model of the aircraft is wrong by a few per cent: not measured",
}


def _channels() -> list[Channel]:
    # A fault reaches the aircraft with FDI and the one without; the healthy twin's columns come last.
    reached = range(HEALTHY)
    found = [
        Channel(
            name=f"{GYRO}.{axis}",
            label=f"Gyro {axis}",
            unit="rad/s",
            sensor=f"{GYRO}.{axis[0]}",
            group=GYRO,
            parts=tuple(len(AXES) * a + i for a in reached),
            kinds=ALL_KINDS,
            typical=0.1,
        )
        for i, axis in enumerate(AXES)
    ]
    found += [
        Channel(
            name=f"{AIR}.{quantity}.value",
            label=label,
            unit=unit,
            sensor=AIR,
            group=f"{AIR}.{quantity}",
            parts=tuple(reached),
            kinds=ALL_KINDS,
            typical=typical,
        )
        for quantity, (label, unit, typical) in _AIR.items()
    ]
    return found


def _tests() -> list[Test]:
    found = []
    for name, label in TEST_LABELS.items():
        dof, source, probability = _OF_TEST[name]
        below = name in ("isolation-angle", "fault-plane")
        found.append(
            Test(
                name=name,
                label=label,
                subjects=tuple(subject for test, subject in TESTS if test == name),
                dof=dof,
                source=source,
                may_drive=name not in ("parity", "parity-trusted", "ukf"),
                unit="deg" if name == "isolation-angle" else "1",
                alarm_when="below" if below else "above",
                reference=("air",) if name == "ukf" else (),
                probability=probability,
                probability_note=_NOTES.get(name, ""),
            )
        )
    return found


def _signals() -> list[Signal]:
    found = []
    for estimator, label in ESTIMATORS.items():
        for quantity, (unit, parts) in ERRORS.items():
            for part in parts:
                words = "rate error" if quantity == "rate" else f"{quantity} off the healthy twin's"
                name = f"{estimator}.error.{quantity}.{part}"
                found.append(Signal(name=name, label=f"{label}: {words}, {part}", unit=unit, group="error"))
        words = f"{label}: distance from the healthy twin"
        found.append(Signal(name=f"{estimator}.distance", label=words, unit="m", group="error"))
    found += signals_of_tests(TESTS, TEST_LABELS, subject_label, {"isolation-angle": "deg"})
    for i in (1, 2, 3):
        found.append(Signal(name=f"parity.{i}", label=f"parity vector {i}", unit="rad/s", group="parity"))
    for axis in AXES:
        found.append(
            Signal(name=f"residual.ukf.{axis}", label=f"UKF residual, gyro {axis}", unit="rad/s", group="residual")
        )
    found += used_signals(SUBJECTS, subject_label)
    for name, label in (
        ("ukf.active", "UKF runs"),
        ("isolation.open", "somebody is in doubt"),
        ("isolation.ambiguous", "ambiguous: the UKF cannot tell either"),
        ("control.by-ukf", "control flies on the rates of the UKF"),
    ):
        found.append(Signal(name=name, label=label, unit="1", group="decision"))
    assert len(FLOWN) == AIRCRAFT
    for aircraft in FLOWN:
        for part in ("east", "north", "up"):
            label = f"{FLOWN_LABELS[aircraft]}: way {part}"
            found.append(Signal(name=f"path.{aircraft}.{part}", label=label, unit="m", group="flight"))
    for aircraft in FLOWN:
        label = f"{FLOWN_LABELS[aircraft]}: height"
        found.append(Signal(name=f"height.{aircraft}", label=label, unit="m", group="flight"))
    found.append(Signal(name="truth.speed", label="true airspeed", unit="m/s", group="flight"))
    for part in ("alpha", "beta", "roll", "pitch", "heading"):
        found.append(Signal(name=f"truth.{part}", label=f"true {part}", unit="deg", group="flight"))
    found.append(Signal(name="control.throttle", label="throttle", unit="1", group="control"))
    for part in ("elevator", "aileron", "rudder"):
        found.append(Signal(name=f"control.{part}", label=part, unit="deg", group="control"))
    found += [
        Signal(name="geometry.gnc", label="J_GNC: navigation index, small is good", unit="1", group="geometry"),
        Signal(name="geometry.fdi", label="J_FDI: isolation index, 4 is best", unit="1", group="geometry"),
    ]
    return found


@lru_cache(maxsize=1)
def description() -> SystemDescription:
    """The whole description."""
    tests = tuple(_tests())
    return SystemDescription(
        id="redundant-imu",
        title="Redundant IMU on an F-16",
        summary=(
            "Three two-axis gyros fly an F-16 through a climb and a bank turn. Parity space detects a fault; where two "
            "gyros look guilty an unscented Kalman filter on the aircraft's own dynamics decides."
        ),
        source=(
            "H.S. Kim, S.K. Park, Y. Kim and C.G. Park, Hybrid fault detection and isolation method for UAV inertial "
            "sensor redundancy management system, IFAC 2005"
        ),
        epoch=EPOCH,
        channels=tuple(_channels()),
        subsystems=(
            *(Subsystem(name=s, label=subject_label(s).capitalize()) for s in SUBJECTS),
            Subsystem(name=AIR, label="Air data", isolable=False),
        ),
        estimators=ESTIMATORS,
        tests=tests,
        signals=tuple(_signals()),
        charts=with_probabilities(tuple(charts()), tests),
        blocks=tuple(blocks()),
        wires=tuple(wires()),
        scene=tuple(scene()),
        settings_schema=Settings.model_json_schema(),
        parameters_schema=Parameters.model_json_schema(),
        score_headline=("protected.distance", "unprotected.distance"),
        recovery=RECOVERY,
        score_label="Furthest off the healthy path",
    )
