"""How the SINS/GPS/Doppler system describes itself: channels, tests, signals, charts, diagram, scene."""

from __future__ import annotations

from functools import lru_cache

from ftcore.description import (
    Block,
    Channel,
    Chart,
    SceneItem,
    Signal,
    Subsystem,
    SystemDescription,
    Test,
    Trace,
    Wire,
)
from ftcore.faults import ALL_KINDS
from ftcore.systems.sins_gps_doppler.forms import Parameters, Settings
from ftcore.world.constellation import almanac

SLOTS = almanac().names
EPOCH = 1.0
ESTIMATORS = {
    "fused": "fault-tolerant",
    "gps": "SINS/GPS alone",
    "doppler": "SINS/Doppler alone",
    "unprotected": "unprotected",
}
AXES = ("1x", "1y", "2x", "2y", "3x", "3y")
CLUSTERS = {"gyro": "gyro", "accelerometer": "accelerometer"}
AIDS = {"gps": "GPS", "doppler": "Doppler"}
AID_TESTS = ("residual", "state", "two-propagator", "glr", "cusum")
IMU_TESTS = ("parity", "glt")
SUBJECTS = (
    "gps",
    "doppler",
    *(f"imu.{cluster}.{k}" for cluster in CLUSTERS for k in (1, 2, 3)),
)
ERRORS = {
    "position": ("m", ("east", "north", "up")),
    "velocity": ("m/s", ("east", "north", "up")),
    "attitude": ("mrad", ("east", "north", "up")),
}
_TEST_LABELS = {
    "residual": "residual test",
    "state": "state chi-square test",
    "two-propagator": "two-propagator test",
    "glr": "windowed GLR",
    "cusum": "CUSUM",
    "parity": "parity test",
    "glt": "GLT",
}
_ROLES = {"fused": "protected", "gps": "local", "doppler": "local", "unprotected": "unprotected"}


def aid_tests() -> list[tuple[str, str]]:
    """(test, subject) of the tests on GPS and Doppler, in column order."""
    return [(test, subject) for test in AID_TESTS for subject in AIDS]


def imu_tests() -> list[tuple[str, str]]:
    """(test, subject) of the tests on the redundant IMU, in column order."""
    return [
        (test, subject)
        for test in IMU_TESTS
        for cluster in CLUSTERS
        for subject in (f"imu.{cluster}", *(f"imu.{cluster}.{k}" for k in (1, 2, 3)))
    ]


TESTS = (*aid_tests(), *imu_tests())


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
    found = [Test(name=n, label=_TEST_LABELS[n], subjects=aids, dof=dof, source=source) for n, dof, source in rows]
    for name, source in (("parity", "001 (29)-(32)"), ("glt", "000 [12]")):
        found.append(
            Test(
                name=name,
                label=_TEST_LABELS[name],
                subjects=imu,
                dof="3 for the whole; 1 for an instrument",
                source=source,
            )
        )
    return found


def _subject_label(subject: str) -> str:
    if subject in AIDS:
        return f"SINS/{AIDS[subject]}"
    words = subject.split(".")
    return words[1] + ("s" if len(words) == 2 else f" {words[2]}")


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
            label = f"{_TEST_LABELS[test]}, {_subject_label(subject)}: {part}"
            found.append(Signal(name=f"test.{test}.{subject}.{part}", label=label, unit="1", group="test"))
    for cluster, unit in (("gyro", "deg/h"), ("accelerometer", "mg")):
        for i in (1, 2, 3):
            found.append(
                Signal(name=f"parity.{cluster}.{i}", label=f"{cluster} parity vector {i}", unit=unit, group="parity")
            )
    for subject in SUBJECTS:
        found.append(
            Signal(name=f"used.{subject}", label=f"{_subject_label(subject)} used", unit="1", group="decision")
        )
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
        Signal(name="gps.hdop", label="HDOP", unit="1", group="geometry"),
        Signal(name="truth.height", label="true height", unit="m", group="flight"),
        Signal(name="truth.speed", label="true ground speed", unit="m/s", group="flight"),
        Signal(name="truth.roll", label="true roll", unit="deg", group="flight"),
        Signal(name="truth.pitch", label="true pitch", unit="deg", group="flight"),
        Signal(name="truth.heading", label="true heading", unit="deg", group="flight"),
    ]
    return found


def _error_chart(quantity: str, part: str, title: str, shown: bool = False) -> Chart:
    unit = ERRORS[quantity][0]
    traces = tuple(
        Trace(
            signal=f"{estimator}.error.{quantity}.{part}",
            label=label,
            role=_ROLES[estimator],  # type: ignore[arg-type]
            sigma=f"fused.sigma.{quantity}.{part}" if estimator == "fused" else None,
        )
        for estimator, label in ESTIMATORS.items()
        # Doppler alone never learns its position: tens of metres, that would flatten the others.
        if not (quantity == "position" and estimator == "doppler")
    )
    return Chart(id=f"{quantity}-{part}", title=title, unit=unit, group="errors", traces=traces, shown=shown)


def _test_chart(test: str, subject: str, shown: bool = False) -> Chart:
    stem = f"test.{test}.{subject}"
    traces = [
        Trace(signal=f"{stem}.statistic", label="statistic", role="statistic"),
        Trace(signal=f"{stem}.threshold", label="threshold", role="threshold"),
    ]
    title = f"{_TEST_LABELS[test][0].upper()}{_TEST_LABELS[test][1:]}, {_subject_label(subject)}"
    return Chart(
        id=f"{test}-{subject}", title=title, unit="1", group="tests", scale="log", traces=tuple(traces), shown=shown
    )


def _charts() -> list[Chart]:
    names = {"east": "East", "north": "North"}
    charts = [_error_chart("position", "up", "Altitude error", shown=True)]
    charts += [_error_chart("position", p, f"{n} position error") for p, n in names.items()]
    charts += [_error_chart("velocity", "east", "East velocity error", shown=True)]
    charts += [
        _error_chart("velocity", "north", "North velocity error"),
        _error_chart("velocity", "up", "Vertical velocity error"),
        _error_chart("attitude", "east", "East tilt error"),
        _error_chart("attitude", "north", "North tilt error"),
        _error_chart("attitude", "up", "Azimuth error"),
    ]
    charts.append(
        Chart(
            id="position-doppler",
            title="Position error of SINS/Doppler alone",
            unit="m",
            group="errors",
            traces=tuple(
                Trace(signal=f"doppler.error.position.{p}", label=p, role="component") for p in ("east", "north", "up")
            ),
        )
    )
    for test in AID_TESTS:
        for subject in AIDS:
            charts.append(_test_chart(test, subject, shown=(test, subject) in {("residual", "gps"), ("state", "gps")}))
    for test in IMU_TESTS:
        for cluster in CLUSTERS:
            charts.append(_test_chart(test, f"imu.{cluster}", shown=(test, cluster) == ("parity", "accelerometer")))
    for cluster, unit in (("gyro", "deg/h"), ("accelerometer", "mg")):
        charts.append(
            Chart(
                id=f"parity-vector-{cluster}",
                title=f"Parity vector, {cluster}s",
                unit=unit,
                group="parity",
                traces=tuple(Trace(signal=f"parity.{cluster}.{i}", label=f"component {i}") for i in (1, 2, 3)),
            )
        )
    charts.append(
        Chart(
            id="isolation-accelerometer",
            title="GLT of each accelerometer",
            unit="1",
            group="parity",
            scale="log",
            traces=tuple(
                Trace(signal=f"test.glt.imu.accelerometer.{k}.statistic", label=f"accelerometer {k}") for k in (1, 2, 3)
            ),
        )
    )
    charts.append(
        Chart(
            id="isolation-gyro",
            title="GLT of each gyro",
            unit="1",
            group="parity",
            scale="log",
            traces=tuple(Trace(signal=f"test.glt.imu.gyro.{k}.statistic", label=f"gyro {k}") for k in (1, 2, 3)),
        )
    )
    charts.append(
        Chart(
            id="doppler-output",
            title="Doppler forward velocity: reading and estimate",
            unit="m/s",
            group="outputs",
            traces=(
                Trace(signal="estimate.doppler.x", label="estimated output", role="protected"),
                Trace(signal="reading.doppler.x", label="reading", role="local"),
            ),
        )
    )
    charts.append(
        Chart(
            id="gps-discrepancy",
            title="Pseudoranges: reading minus estimated output",
            unit="m",
            group="outputs",
            traces=tuple(Trace(signal=f"discrepancy.gps.{slot}", label=slot) for slot in SLOTS),
        )
    )
    charts.append(
        Chart(
            id="nees",
            title="Consistency: NEES of 9 states",
            unit="1",
            group="consistency",
            scale="log",
            traces=tuple(
                Trace(signal=f"{e}.nees", label=label, role=_ROLES[e])  # type: ignore[arg-type]
                for e, label in ESTIMATORS.items()
            ),
        )
    )
    charts.append(
        Chart(
            id="geometry",
            title="Satellites in use, and HDOP",
            unit="1",
            group="outputs",
            traces=(
                Trace(signal="gps.satellites", label="satellites in use"),
                Trace(signal="gps.hdop", label="HDOP"),
            ),
        )
    )
    return charts


def _blocks() -> list[Block]:
    drives = ("driving_test", "false_alarm_probability", "propagator_period")
    return [
        Block(id="gps", label="GPS", kind="sensor", x=1, y=2, width=22, height=11, sensor="gps", subsystem="gps"),
        Block(id="gyro", label="Gyros", kind="sensor", x=1, y=16, width=22, height=11, sensor="imu.gyro"),
        Block(
            id="accelerometer", label="Accels", kind="sensor", x=1, y=29, width=22, height=11,
            sensor="imu.accelerometer",
        ),
        Block(
            id="altimeter", label="Altimeter", kind="sensor", x=1, y=42, width=22, height=11, sensor="altimeter",
            subsystem="altimeter",
        ),
        Block(
            id="doppler", label="Doppler", kind="sensor", x=1, y=55, width=22, height=11, sensor="doppler",
            subsystem="doppler",
        ),
        Block(
            id="imu-fdi", label="IMU FDI", kind="test", x=27, y=20, width=20, height=14, sensor="imu",
            settings=("imu_driving_test", "false_alarm_probability"),
        ),
        Block(id="sins", label="SINS", kind="computer", x=27, y=40, width=20, height=11),
        Block(
            id="filter-gps", label="SINS/GPS", kind="filter", x=52, y=2, width=22, height=12, settings=("gps_share",)
        ),
        Block(id="tests", label="Tests", kind="test", x=52, y=26, width=22, height=15, settings=drives),
        Block(
            id="filter-doppler", label="SINS/Doppler", kind="filter", x=52, y=54, width=22, height=12,
            settings=("gps_share",),
        ),
        Block(
            id="supervisor", label="Supervisor", kind="supervisor", x=79, y=20, width=20, height=12,
            settings=("confirm", "within", "hold_off"),
        ),
        Block(
            id="master", label="Master", kind="master", x=79, y=40, width=20, height=14,
            settings=("fusion_mode", "master"),
        ),
    ]  # fmt: skip


def _wires() -> list[Wire]:
    pairs: list[tuple[str, str, str | None]] = [
        ("gps", "filter-gps", None),
        ("gyro", "imu-fdi", None),
        ("accelerometer", "imu-fdi", None),
        ("imu-fdi", "sins", None),
        ("altimeter", "sins", "altimeter"),
        ("doppler", "filter-doppler", None),
        ("sins", "filter-gps", None),
        ("sins", "filter-doppler", None),
        ("filter-gps", "tests", None),
        ("filter-doppler", "tests", None),
        ("tests", "supervisor", None),
        ("supervisor", "master", None),
        ("filter-gps", "master", "gps"),
        ("filter-doppler", "master", "doppler"),
    ]
    return [Wire(source=a, target=b, carries=c) for a, b, c in pairs]


def _scene() -> list[SceneItem]:
    items = [SceneItem(id="aircraft", label="aircraft", kind="aircraft", frame="level", family="aircraft")]
    for cluster in CLUSTERS:
        for axis in AXES:
            items.append(
                SceneItem(
                    id=f"axis.{cluster}.{axis}",
                    label=f"{cluster[0].upper()}{axis}",
                    kind="axis",
                    family=f"instrument {axis[0]}",
                    channel=f"imu.{cluster}.{axis}",
                )
            )
    for k in (1, 2, 3):
        items.append(SceneItem(id=f"spin.{k}", label=f"spin {k}", kind="spin", family=f"instrument {k}"))
        items.append(SceneItem(id=f"plane.{k}", label=f"fault plane {k}", kind="plane", family=f"instrument {k}"))
    for cluster in CLUSTERS:
        items.append(
            SceneItem(id=f"parity.{cluster}", label=f"{cluster} parity", kind="vector", family="parity vector")
        )
    for slot in SLOTS:
        items.append(
            SceneItem(
                id=f"satellite.{slot}",
                label=slot,
                kind="line-of-sight",
                frame="level",
                family="satellites",
                channel=f"gps.pseudorange.{slot}",
            )
        )
    return items


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
        charts=tuple(_charts()),
        blocks=tuple(_blocks()),
        wires=tuple(_wires()),
        scene=tuple(_scene()),
        settings_schema=Settings.model_json_schema(),
        parameters_schema=Parameters.model_json_schema(),
        score_headline=("fused.error.position.up", "unprotected.error.position.up"),
    )
