"""How the GPS receiver describes itself: channels, tests, signals, charts, diagram, scene."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from ftcore.description import (
    Block,
    Channel,
    SceneItem,
    Signal,
    Subsystem,
    SystemDescription,
    Test,
    Wire,
    with_probabilities,
)
from ftcore.faults import ALL_KINDS
from ftcore.systems.declarations import signals_of_tests
from ftcore.systems.gps_receiver.charts import charts
from ftcore.systems.gps_receiver.forms import Parameters, Settings
from ftcore.systems.gps_receiver.names import EPOCH, ESTIMATORS, PRNS, SATELLITES, SUBJECTS, TEST_LABELS, TESTS

_CODES: Final = "0 consistent, 1 satellites excluded, 2 cannot isolate, 3 cannot detect, 4 no fix"
_CLASSES: Final = "0 nominal, 1 misleading, 2 hazardously misleading, 3 unavailable"

_STANDS_STILL: Final = (
    "the filter allows for a receiver that moves (position noise S_p), and the simulated one stands still; "
    "with S_p = 0 it is exact"
)


def _channels() -> list[Channel]:
    found = [
        Channel(
            name=f"gps.pseudorange.{name}",
            label=f"Pseudorange {name}" + (" (log)" if name in PRNS else ""),
            unit="m",
            sensor=f"gps.{name}",
            group="gps.pseudorange",
            parts=(i,),
            kinds=ALL_KINDS,
            typical=100.0,
        )
        for i, name in enumerate(SATELLITES)
    ]
    everything = Channel(
        name="gps.pseudorange.all",
        label="Pseudoranges of all satellites",
        unit="m",
        sensor="gps",
        group="gps.pseudorange",
        parts=tuple(range(len(SATELLITES))),
        kinds=ALL_KINDS,
        typical=100.0,
    )
    return [*found, everything]


def _tests() -> list[Test]:
    whole = "satellites minus 4; a satellite: 1, and it alarms where the test of all names it"
    filtered = "satellites; a satellite: 1, and it alarms where the test of all names it"
    return [
        Test(
            name="snapshot",
            label="snapshot test",
            subjects=SUBJECTS,
            dof=whole,
            source="Chey 2004 (9)-(12)",
            probability="exact",
            probability_note="a satellite alarms only where the whole does and names it, at an eighth of the stated "
            "probability",
        ),
        Test(
            name="innovation",
            label="innovation test",
            subjects=SUBJECTS,
            dof=filtered,
            source="Chey 2004, section 3",
            probability="bounded",
            probability_note=f"alarms at 0.7 of the stated probability: {_STANDS_STILL}",
        ),
        Test(
            name="parity",
            label="parity-space test",
            subjects=("gps",),
            dof="satellites minus 4",
            source="Sturza; equal to the snapshot test (Brown 1992)",
            may_drive=False,
            probability="exact",
        ),
        Test(
            name="agreement",
            label="combined filter against snapshot",
            subjects=("gps",),
            dof="4: position and clock",
            source="FTLab: what resets the combined filter",
            may_drive=False,
            probability="bounded",
            probability_note=f"alarms at 0.3 to 0.6 of the stated probability: {_STANDS_STILL}",
        ),
    ]


def _subject_label(subject: str) -> str:
    return "all satellites" if subject == "gps" else subject.removeprefix("gps.")


def _signals() -> list[Signal]:
    found = []

    def add(name: str, label: str, unit: str, group: str) -> None:
        found.append(Signal(name=name, label=label, unit=unit, group=group))

    for estimator, label in ESTIMATORS.items():
        for part in ("east", "north", "up", "horizontal"):
            add(f"{estimator}.error.position.{part}", f"{label}: {part} position error", "m", "error")
        for part in ("east", "north", "up"):
            add(f"{estimator}.sigma.position.{part}", f"{label}: position {part} 1-sigma", "m", "sigma")
        add(f"{estimator}.status", f"{label}: {_CODES}", "1", "integrity")
        add(f"{estimator}.satellites", f"{label}: satellites used", "1", "geometry")
        add(f"{estimator}.protection", f"{label}: horizontal protection level of its satellites", "m", "integrity")
        add(f"{estimator}.stanford", f"{label}: {_CLASSES}", "1", "integrity")
    found += signals_of_tests(TESTS, TEST_LABELS, _subject_label)
    add("protection.horizontal", "horizontal protection level of the combined solution's satellites", "m", "integrity")
    add("protection.slope", "the same by slope", "m", "integrity")
    add("protection.separation", "the same by solution separation", "m", "integrity")
    add("protection.alert", "alert limit", "m", "integrity")
    add("gps.hdop", "HDOP", "1", "geometry")
    add("gps.dof", "degrees of freedom of the snapshot", "1", "geometry")
    add("gps.satellites", "satellites in view", "1", "geometry")
    add("gps.time", "receiver time, seconds of the GPS week", "s", "geometry")
    add("residual.threshold", "threshold of one satellite's residual, in sigmas", "1", "residual")
    for stem, words, unit, group in (
        ("used.gps.{}", "{} used by the combined solution", "1", "decision"),
        ("residual.snapshot.{}", "{}: snapshot residual against all others, in sigmas", "1", "residual"),
        ("residual.innovation.{}", "{}: innovation against all others, in sigmas", "1", "residual"),
        ("detectable.{}", "{}: minimal detectable bias", "m", "integrity"),
        ("elevation.{}", "{}: elevation", "deg", "sky"),
        ("azimuth.{}", "{}: azimuth", "deg", "sky"),
    ):
        for name in SATELLITES:
            add(stem.format(name), words.format(name), unit, group)
    return found


def _blocks() -> list[Block]:
    tests = ("false_alarm_probability", "wrong_isolation_probability")
    levels = ("alert_limit", "protection", "missed_detection_probability")
    return [
        Block(
            id="satellites", label="Satellites", kind="sensor", x=1, y=27, width=20, height=13, sensor="gps",
            subsystem="gps",
        ),
        Block(id="snapshot-test", label="Snapshot test", kind="test", x=24, y=3, width=25, height=12, settings=tests),
        Block(id="snapshot", label="Snapshot", kind="computer", x=78, y=3, width=21, height=12),
        Block(
            id="innovation-test", label="Innovation test", kind="test", x=24, y=27, width=25, height=13, settings=tests
        ),
        Block(
            id="combination", label="Combination", kind="supervisor", x=52, y=20, width=23, height=14,
            settings=("combination", "confirm", "within", "hold_off"),
        ),
        Block(
            id="combined", label="Combined", kind="master", x=78, y=20, width=21, height=12, settings=("reset_after",)
        ),
        Block(id="filter", label="Filter", kind="filter", x=52, y=38, width=23, height=11),
        Block(id="protection", label="Protection", kind="test", x=78, y=36, width=21, height=13, settings=levels),
        Block(id="unprotected", label="Unprotected", kind="filter", x=52, y=54, width=23, height=11),
    ]  # fmt: skip


def _wires() -> list[Wire]:
    pairs = [
        ("satellites", "snapshot-test"),
        ("snapshot-test", "snapshot"),
        ("snapshot-test", "combination"),
        ("satellites", "innovation-test"),
        ("innovation-test", "combination"),
        ("innovation-test", "filter"),
        ("combination", "combined"),
        ("combined", "protection"),
        ("satellites", "unprotected"),
    ]
    return [Wire(source=a, target=b) for a, b in pairs]


def _scene() -> list[SceneItem]:
    return [
        SceneItem(
            id=f"satellite.{name}",
            label=name,
            kind="line-of-sight",
            frame="level",
            family="satellites",
            channel=f"gps.pseudorange.{name}",
        )
        for name in SATELLITES
    ]


@lru_cache(maxsize=1)
def description() -> SystemDescription:
    """The whole description."""
    tests = tuple(_tests())
    return SystemDescription(
        id="gps-receiver",
        title="GPS receiver with integrity",
        summary=(
            "A standing GPS receiver, simulated or from a real log, whose faulty satellites are found by a snapshot "
            "test, by a filter, and by both combined, with the error that could hide."
        ),
        source="J. Chey, G.-I. Jee and J.G. Lee, Combining approach in FDI for GPS applications, ICCAS 2004",
        epoch=EPOCH,
        channels=tuple(_channels()),
        subsystems=(Subsystem(name="gps", label="GPS"),),
        estimators=ESTIMATORS,
        tests=tests,
        signals=tuple(_signals()),
        charts=with_probabilities(tuple(charts()), tests),
        blocks=tuple(_blocks()),
        wires=tuple(_wires()),
        scene=tuple(_scene()),
        settings_schema=Settings.model_json_schema(),
        parameters_schema=Parameters.model_json_schema(),
        score_headline=("combined.error.position.horizontal", "unprotected.error.position.horizontal"),
    )
