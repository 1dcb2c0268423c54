"""How the SINS/GPS/Doppler system describes itself: channels, tests, signals, charts, diagram, scene."""

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
from ftcore.systems.declarations import (
    declared_imu_tests,
    flight_signals,
    navigation_signals,
    parity_signals,
    signals_of_tests,
    used_signals,
)
from ftcore.systems.sins_gps_doppler.charts import charts
from ftcore.systems.sins_gps_doppler.forms import Parameters, Settings
from ftcore.systems.sins_gps_doppler.names import (
    AIDS,
    ALTIMETER,
    AXES,
    CLUSTERS,
    EPOCH,
    ERRORS,
    ESTIMATORS,
    SLOTS,
    SUBJECTS,
    SUBSETS,
    TEST_LABELS,
    TESTS,
    subject_label,
)
from ftcore.systems.sins_gps_doppler.pictures import blocks, scene, wires

_GLR = "the largest of many likelihood ratios, as if they were independent (Sidak)"


def _channels() -> list[Channel]:
    found = []
    for cluster, unit, typical in (("gyro", "deg/h", 20.0), ("accelerometer", "mg", 1.0)):
        for i, axis in enumerate(AXES):
            found.append(
                Channel(
                    name=f"imu.{cluster}.{axis}",
                    label=f"{cluster.capitalize()} {axis}",
                    unit=unit,
                    sensor=f"imu.{cluster}.{axis[0]}",
                    group=f"imu.{cluster}",
                    parts=(i,),
                    kinds=ALL_KINDS,
                    typical=typical,
                )
            )
    for quantity, label, unit, typical in (
        ("pseudorange", "pseudorange", "m", 100.0),
        ("delta_range", "delta pseudorange", "m/s", 2.0),
    ):
        for i, slot in enumerate(SLOTS):
            found.append(_aid("gps", quantity, slot, f"GPS {label} {slot}", unit, (i,), typical))
        everything = tuple(range(len(SLOTS)))
        found.append(_aid("gps", quantity, "all", f"GPS {label}, all satellites", unit, everything, typical))
    for i, (axis, label) in enumerate((("x", "forward"), ("y", "right"), ("z", "down"))):
        found.append(_aid("doppler", "velocity", axis, f"Doppler velocity {label}", "m/s", (i,), 2.0))
    found.append(_aid("doppler", "velocity", "all", "Doppler velocity, all axes", "m/s", (0, 1, 2), 2.0))
    found.append(_aid("altimeter", "height", "up", "Altimeter height", "m", (0,), 100.0))
    return found


def _aid(
    sensor: str, quantity: str, part: str, label: str, unit: str, parts: tuple[int, ...], typical: float
) -> Channel:
    return Channel(
        name=f"{sensor}.{quantity}.{part}",
        label=label,
        unit=unit,
        sensor=sensor,
        group=f"{sensor}.{quantity}",
        parts=parts,
        kinds=ALL_KINDS,
        typical=typical,
    )


def _tests() -> list[Test]:
    aids = tuple(AIDS)
    rows: tuple[tuple[str, str, str, Probability, str], ...] = (
        ("residual", "number of measurements", "Zhang 1992 (56)-(57)", "exact", ""),
        ("state", "rank of P2 - P1", "Zhang 1992 (48)-(52), rank-aware", "exact", ""),
        ("two-propagator", "number of measurements", "Yang 2016, innovation form", "exact", ""),
        ("glr", "1 for each onset and channel", "Willsky and Jones", "bounded", _GLR),
        ("cusum", "1 (normal scores of the residual statistic)", "Page; Brook and Evans", "exact", ""),
    )
    found = [
        Test(
            name=n,
            label=TEST_LABELS[n],
            subjects=aids,
            dof=dof,
            source=source,
            reference=("imu", "altimeter"),
            probability=probability,
            probability_note=note,
        )
        for n, dof, source, probability, note in rows
    ]
    found += declared_imu_tests(TEST_LABELS, TESTS)
    found.append(
        Test(
            name="parity-trusted",
            label=TEST_LABELS["parity-trusted"],
            subjects=tuple(f"imu.{c}" for c in CLUSTERS),
            dof="1 while an instrument is out; none while all are trusted",
            source="Kim 2005 (29)-(32)",
            may_drive=False,
            probability="exact",
        )
    )
    found.append(
        Test(
            name="integrity",
            label=TEST_LABELS["integrity"],
            subjects=("gps",),
            dof="ranges minus unknowns, and rates minus as many; none while it is off",
            source="Chey 2004; Brown 1992",
            may_drive=False,
            probability="exact",
        )
    )
    found.append(
        Test(
            name="altimeter",
            label=TEST_LABELS["altimeter"],
            subjects=(ALTIMETER,),
            dof="1",
            source="FTLab: innovation before it damps the strapdown",
            probability="exact",
        )
    )
    return found


def _signals() -> list[Signal]:
    found = navigation_signals(ESTIMATORS, ERRORS) + signals_of_tests(TESTS, TEST_LABELS, subject_label)
    found += parity_signals()
    found += used_signals(SUBJECTS, subject_label)
    for axis in ("x", "y", "z"):
        found.append(
            Signal(name=f"reading.doppler.{axis}", label=f"Doppler {axis}: reading", unit="m/s", group="output")
        )
        found.append(
            Signal(
                name=f"estimate.doppler.{axis}", label=f"Doppler {axis}: estimated output", unit="m/s", group="output"
            )
        )
    for slot in SLOTS:
        found.append(
            Signal(
                name=f"discrepancy.gps.{slot}",
                label=f"pseudorange {slot}: reading minus estimated output",
                unit="m",
                group="output",
            )
        )
    found.append(
        Signal(name="discrepancy.altimeter", label="altimeter: reading minus its prediction", unit="m", group="output")
    )
    found += [
        Signal(name="gps.satellites", label="satellites in use", unit="1", group="geometry"),
        Signal(name="gps.excluded", label="satellites left out", unit="1", group="geometry"),
        Signal(name="gps.hdop", label="HDOP", unit="1", group="geometry"),
        *(
            Signal(name=f"weight.{n}", label=f"weight of the estimate, {text}", unit="1", group="weight")
            for n, text in SUBSETS.items()
        ),
        *flight_signals(),
    ]
    return found


@lru_cache(maxsize=1)
def description() -> SystemDescription:
    """The whole description."""
    tests = tuple(_tests())
    return SystemDescription(
        id="sins-gps-doppler",
        title="SINS/GPS/Doppler federated system",
        summary=(
            "A strapdown inertial system with a redundant IMU, aided by GPS and Doppler radar through two local "
            "filters and a fault-tolerant master."
        ),
        source="H.G. Zhang and H.Y. Zhang, Fault tolerant scheme for multisensor navigation system, ICAS 1992",
        epoch=EPOCH,
        channels=tuple(_channels()),
        subsystems=(
            Subsystem(name="gps", label="GPS"),
            Subsystem(name="doppler", label="Doppler"),
            Subsystem(name="altimeter", label="Altimeter"),
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
        score_headline=("fused.error.position.up", "unprotected.error.position.up"),
        score_label="Worst altitude error",
    )
