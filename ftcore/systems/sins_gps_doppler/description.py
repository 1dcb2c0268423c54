"""How the SINS/GPS/Doppler system describes itself: channels, tests, signals, charts, diagram, scene."""

from __future__ import annotations

from functools import lru_cache

from ftcore.description import (
    Channel,
    Signal,
    Subsystem,
    SystemDescription,
    Test,
)
from ftcore.faults import ALL_KINDS
from ftcore.systems.sins_gps_doppler.charts import charts
from ftcore.systems.sins_gps_doppler.forms import Parameters, Settings
from ftcore.systems.sins_gps_doppler.names import (
    AIDS,
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
    imu = tuple(s for c in CLUSTERS for s in (f"imu.{c}", f"imu.{c}.1", f"imu.{c}.2", f"imu.{c}.3"))
    rows = (
        ("residual", "number of measurements", "000 (56)-(57)"),
        ("state", "rank of P2 - P1", "000 (48)-(52), rank-aware"),
        ("two-propagator", "number of measurements", "002, innovation form"),
        ("glr", "1 for each onset and channel", "Willsky and Jones"),
        ("cusum", "1 (normal scores of the residual statistic)", "Page; Brook and Evans"),
    )
    found = [Test(name=n, label=TEST_LABELS[n], subjects=aids, dof=dof, source=source) for n, dof, source in rows]
    for name, source in (("parity", "001 (29)-(32)"), ("glt", "000 [12]")):
        found.append(
            Test(
                name=name,
                label=TEST_LABELS[name],
                subjects=imu,
                dof="3 for the whole; 1 for an instrument",
                source=source,
            )
        )
    found.append(
        Test(
            name="parity-trusted",
            label=TEST_LABELS["parity-trusted"],
            subjects=tuple(f"imu.{c}" for c in CLUSTERS),
            dof="1 while an instrument is out; none while all are trusted",
            source="001 (29)-(32)",
            may_drive=False,
        )
    )
    found.append(
        Test(
            name="integrity",
            label=TEST_LABELS["integrity"],
            subjects=("gps",),
            dof="ranges minus unknowns, and rates minus as many; none while it is off",
            source="003; Brown 1992",
            may_drive=False,
        )
    )
    return found


def _signals() -> list[Signal]:
    found = []
    for estimator, label in ESTIMATORS.items():
        for kind in ("error", "sigma"):
            for quantity, (unit, parts) in ERRORS.items():
                for part in parts:
                    name = f"{estimator}.{kind}.{quantity}.{part}"
                    words = f"{label}: {quantity} {part} {'error' if kind == 'error' else '1-sigma'}"
                    found.append(Signal(name=name, label=words, unit=unit, group=kind))
        horizontal = f"{estimator}.error.position.horizontal"
        found.append(Signal(name=horizontal, label=f"{label}: horizontal position error", unit="m", group="error"))
        found.append(Signal(name=f"{estimator}.nees", label=f"{label}: NEES, 9 states", unit="1", group="consistency"))
    for test, subject in TESTS:
        for part in ("statistic", "threshold", "dof", "alarm"):
            label = f"{TEST_LABELS[test]}, {subject_label(subject)}: {part}"
            found.append(Signal(name=f"test.{test}.{subject}.{part}", label=label, unit="1", group="test"))
    for cluster, unit in (("gyro", "deg/h"), ("accelerometer", "mg")):
        for i in (1, 2, 3):
            found.append(
                Signal(name=f"parity.{cluster}.{i}", label=f"{cluster} parity vector {i}", unit=unit, group="parity")
            )
    for subject in SUBJECTS:
        found.append(Signal(name=f"used.{subject}", label=f"{subject_label(subject)} used", unit="1", group="decision"))
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
    found += [
        Signal(name="gps.satellites", label="satellites in use", unit="1", group="geometry"),
        Signal(name="gps.excluded", label="satellites left out", unit="1", group="geometry"),
        Signal(name="gps.hdop", label="HDOP", unit="1", group="geometry"),
        *(
            Signal(name=f"weight.{n}", label=f"weight of the estimate, {text}", unit="1", group="weight")
            for n, text in SUBSETS.items()
        ),
        Signal(name="truth.height", label="true height", unit="m", group="flight"),
        Signal(name="truth.speed", label="true ground speed", unit="m/s", group="flight"),
        Signal(name="truth.roll", label="true roll", unit="deg", group="flight"),
        Signal(name="truth.pitch", label="true pitch", unit="deg", group="flight"),
        Signal(name="truth.heading", label="true heading", unit="deg", group="flight"),
    ]
    return found


@lru_cache(maxsize=1)
def description() -> SystemDescription:
    """The whole description."""
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
            Subsystem(name="altimeter", label="Altimeter", isolable=False),
        ),
        estimators=ESTIMATORS,
        tests=tuple(_tests()),
        signals=tuple(_signals()),
        charts=tuple(charts()),
        blocks=tuple(blocks()),
        wires=tuple(wires()),
        scene=tuple(scene()),
        settings_schema=Settings.model_json_schema(),
        parameters_schema=Parameters.model_json_schema(),
        score_headline=("fused.error.position.up", "unprotected.error.position.up"),
        score_label="Worst altitude error",
    )
