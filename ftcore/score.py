"""Score: a flight against the truth.

Per fault: when which test noticed, when the culprit was named, who was wrongly accused, when it was trusted again, what
it cost. Per test: alarms while nothing was wrong. Per estimator: errors and consistency. Times are medians over runs,
given with the share of runs in which they happened at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from ftcore import units
from ftcore.description import SystemDescription
from ftcore.events import Event
from ftcore.faults import KINDS, ChannelAddress, Fault
from ftcore.recording import Recording

Array = NDArray[np.float64]

SETTLING = 20.0
"""Seconds at the start that do not count as errors: the filters are still converging."""


class Delay(BaseModel):
    """A delay after onset: median over the runs in which it happened [s], and the share of runs in which it did."""

    median: float | None
    share: float


class FaultScore(BaseModel):
    """What one fault did."""

    id: str
    label: str
    channel: str
    sensor: str
    start: float
    end: float | None
    time_to_alarm: dict[str, float | None]
    alarmed_share: dict[str, float]
    time_to_isolate: float | None
    isolated_share: float
    isolated: list[str]
    wrong_isolations: list[str]
    wrong_share: float
    time_to_readmit: float | None
    worst: dict[str, float]


class TestScore(BaseModel):
    """Alarms of one test while nothing that concerns it was wrong."""

    name: str
    subject: str
    alarms: int
    epochs: int
    false_alarm_rate: float | None


class ErrorScore(BaseModel):
    """Root mean square and worst absolute error [SI], after settling."""

    rms: float | None
    worst: float | None


class EstimatorScore(BaseModel):
    """One estimator: position, velocity, attitude, and the mean normalised error squared."""

    position: ErrorScore
    velocity: ErrorScore
    attitude: ErrorScore
    nees: float | None
    nees_dof: int | None


class Headline(BaseModel):
    """One item of the score strip."""

    label: str
    value: float | None
    unit: str
    note: str = ""
    compare_label: str | None = None
    compare: float | None = None


class Score(BaseModel):
    """A flight so far against the truth."""

    runs: int
    time: float
    faults: list[FaultScore]
    tests: list[TestScore]
    estimators: dict[str, EstimatorScore]
    headline: list[Headline]


def compute(
    recording: Recording,
    events: Sequence[Event],
    faults: Sequence[Fault],
    description: SystemDescription,
    channels: Mapping[str, ChannelAddress],
) -> Score:
    """Score a recording. Pure; needs nothing of the system but its description."""
    runs = recording.rows.shape[1]
    now = float(recording.time[-1]) if len(recording) else 0.0
    live = [f for f in faults if f.start is not None and f.start <= now]
    scored = [_fault_score(f, live, recording, events, description, channels, runs, now) for f in live]
    tests = [
        _test_score(test.name, subject, recording, live, channels)
        for test in description.tests
        for subject in test.subjects
        if f"test.{test.name}.{subject}.alarm" in recording.column
    ]
    estimators = {name: _estimator_score(name, recording) for name in description.estimators}
    return Score(
        runs=runs,
        time=now,
        faults=scored,
        tests=tests,
        estimators=estimators,
        headline=_headline(recording, description, scored, tests, estimators, now),
    )


def concerns(subject: str, sensor: str) -> bool:
    """Whether a test subject looks at a sensor: the same, a part or the whole of it."""
    return subject == sensor or subject.startswith(sensor + ".") or sensor.startswith(subject + ".")


def _first(
    events: Sequence[Event], kind: str, wanted: Any, start: float, end: float, runs: int
) -> tuple[float | None, float]:
    first: dict[int, float] = {}
    for event in events:
        if event.kind == kind and start - 1e-9 <= event.time <= end and event.run not in first and wanted(event):
            first[event.run] = event.time - start
    return (float(np.median(list(first.values()))) if first else None), len(first) / runs


def _fault_score(
    fault: Fault,
    live: Sequence[Fault],
    recording: Recording,
    events: Sequence[Event],
    description: SystemDescription,
    channels: Mapping[str, ChannelAddress],
    runs: int,
    now: float,
) -> FaultScore:
    assert fault.start is not None
    start = fault.start
    end = now if fault.end is None else min(fault.end, now)
    sensor = channels[fault.channel].sensor
    faulty = {channels[f.channel].sensor for f in live}
    alarm, share = {}, {}
    for test in description.tests:
        if any(concerns(subject, sensor) for subject in test.subjects):
            alarm[test.name], share[test.name] = _first(
                events,
                "test.alarmed",
                lambda e, name=test.name: e.detail.get("test") == name and concerns(e.subject, sensor),
                start,
                end,
                runs,
            )
    isolate, isolated_share = _first(
        events, "subsystem.isolated", lambda e: concerns(e.subject, sensor), start, end, runs
    )
    accused = [e for e in events if e.kind == "subsystem.isolated" and start <= e.time <= end]
    wrong = [e for e in accused if not any(concerns(e.subject, s) for s in faulty)]
    readmit = None
    if fault.end is not None and fault.end <= now:
        readmit, _ = _first(events, "subsystem.readmitted", lambda e: concerns(e.subject, sensor), fault.end, now, runs)
    lo, hi = np.searchsorted(recording.time, [start - 1e-9, end + 1e-9])
    worst = {
        name: worst
        for name in description.score_headline
        if (worst := _worst(recording.rows[lo:hi, :, recording.column[name]])) is not None
    }
    unit = fault.unit or KINDS[fault.kind].unit(channels[fault.channel].unit)
    size = "" if unit is None else f" {fault.magnitude:g} {unit}"
    return FaultScore(
        id=str(fault.id),
        label=f"{fault.channel} {KINDS[fault.kind].label}{size}",
        channel=fault.channel,
        sensor=sensor,
        start=start,
        end=fault.end,
        time_to_alarm=alarm,
        alarmed_share=share,
        time_to_isolate=isolate,
        isolated_share=isolated_share,
        isolated=sorted({e.subject for e in accused if concerns(e.subject, sensor)}),
        wrong_isolations=sorted({e.subject for e in wrong}),
        wrong_share=len({e.run for e in wrong}) / runs,
        time_to_readmit=readmit,
        worst=worst,
    )


def _test_score(
    name: str, subject: str, recording: Recording, live: Sequence[Fault], channels: Mapping[str, ChannelAddress]
) -> TestScore:
    """Epochs count until the first fault that can reach the subject.

    Inertial faults reach every sensor's tests, and a fault of one instrument the tests of all that share its parity
    equations (``imu.gyro``): what they then say of the others is no false alarm, be it right or wrong.
    """
    reached = [
        f.start
        for f in live
        if f.start is not None
        and (not subject.startswith("imu") or _family(subject) == _family(channels[f.channel].sensor))
    ]
    until = min(reached, default=np.inf)
    n = int(np.searchsorted(recording.time, until - 1e-9))
    alarms = recording.rows[:n, :, recording.column[f"test.{name}.{subject}.alarm"]]
    dof = f"test.{name}.{subject}.statistic"
    tested = int(np.isfinite(recording.rows[:n, :, recording.column[dof]]).sum())
    count = int(np.nansum(alarms))
    return TestScore(
        name=name, subject=subject, alarms=count, epochs=tested, false_alarm_rate=count / tested if tested else None
    )


def _family(subject: str) -> list[str]:
    """Instruments of one kind: ``imu.gyro`` of ``imu.gyro.2``."""
    return subject.split(".")[:2]


def _called(description: SystemDescription, subject: str) -> str:
    """How a person calls a subject: as the subsystem, the one thing in the scene it is, or what its channels share."""
    for subsystem in description.subsystems:
        if subsystem.name == subject:
            return subsystem.label
    own = [channel.name for channel in description.channels if channel.sensor == subject]
    items = [item.label for item in description.scene if len(own) == 1 and item.channel == own[0]]
    if items:
        return items[0]
    labels = [channel.label for channel in description.channels if channel.sensor == subject]
    first, last = min(labels, default=""), max(labels, default="")
    shared = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[:shared].rstrip(" ,:") or subject


def _shown(value: float | None, unit: str) -> float | None:
    """A number in SI in the unit that a person reads."""
    return None if value is None else units.from_si(value, unit)


def _worst(values: Array) -> float | None:
    """Largest absolute value; None where there is no number at all."""
    return float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else None


def _estimator_score(name: str, recording: Recording) -> EstimatorScore:
    lo = int(np.searchsorted(recording.time, SETTLING - 1e-9))
    rows = recording.rows[lo:] if len(recording) > lo else recording.rows

    def error(quantity: str) -> ErrorScore:
        prefix = f"{name}.error.{quantity}."
        columns = [i for n, i in recording.column.items() if n.startswith(prefix) and not n.endswith(".horizontal")]
        if not columns or not len(rows):
            return ErrorScore(rms=None, worst=None)
        squared = np.sum(rows[:, :, columns] ** 2, axis=-1)
        if not np.isfinite(squared).any():
            return ErrorScore(rms=None, worst=None)
        return ErrorScore(rms=float(np.sqrt(np.nanmean(squared))), worst=float(np.sqrt(np.nanmax(squared))))

    column = recording.column.get(f"{name}.nees")
    nees = float(np.nanmean(rows[:, :, column])) if column is not None and len(rows) else None
    return EstimatorScore(
        position=error("position"),
        velocity=error("velocity"),
        attitude=error("attitude"),
        nees=nees,
        nees_dof=9 if column is not None else None,
    )


def _headline(
    recording: Recording,
    description: SystemDescription,
    faults: Sequence[FaultScore],
    tests: Sequence[TestScore],
    estimators: Mapping[str, EstimatorScore],
    now: float,
) -> list[Headline]:
    """The score strip: the fault, or how many of several; false alarms; worst error beside the unprotected twin's."""
    items = _of_faults(description, faults)
    drives = {test.name for test in description.tests if test.may_drive}
    counted = [t for t in tests if t.name in drives]
    alarms, epochs = sum(t.alarms for t in counted), sum(t.epochs for t in counted)
    note = f"of {epochs} tests" + (" before a fault could reach them" if faults else "")
    items.append(Headline(label="False alarms", value=float(alarms), unit="", note=note))
    if len(description.score_headline) > 1 and len(recording):
        mine, twin = description.score_headline[:2]
        since = min((f.start for f in faults), default=SETTLING)
        lo = int(np.searchsorted(recording.time, since - 1e-9))
        rows = recording.rows[lo:] if len(recording) > lo else recording.rows
        worst = [_worst(rows[:, :, recording.column[n]]) for n in (mine, twin)]
        signal = recording.signals[mine]
        items.append(
            Headline(
                label=description.score_label,
                value=_shown(worst[0], signal.unit),
                unit=signal.unit,
                note="since the first fault" if faults else "since the filters settled",
                compare_label=description.estimators.get(twin.split(".")[0], twin),
                compare=_shown(worst[1], signal.unit),
            )
        )
    consistent = next(((n, e) for n, e in estimators.items() if e.nees is not None), None)
    if consistent is not None and consistent[1].nees_dof:
        score = consistent[1]
        value = float(score.nees or 0.0) / float(score.nees_dof or 1)
        items.append(
            Headline(
                label="Consistency (NEES / dof)",
                value=value,
                unit="",
                note="1 is consistent",
            )
        )
    return items


def _of_faults(description: SystemDescription, faults: Sequence[FaultScore]) -> list[Headline]:
    """Found and isolated: after how long where one sensor failed, how many where several did or one again."""
    if not faults:
        waiting = ("Fault found after", "Isolated after")
        return [Headline(label=label, value=None, unit="s", note="no fault yet") for label in waiting]
    wrong = sorted({_called(description, s) for f in faults for s in f.wrong_isolations})
    named = sorted({_called(description, s) for f in faults for s in f.isolated})
    words = [f"{', '.join(named)} named"] if named else []
    words += [f"wrongly: {', '.join(wrong)}"] if wrong else []
    whom = "; ".join(words) or "nobody isolated"
    failures: dict[tuple[str, float], list[FaultScore]] = {}
    for fault in faults:
        failures.setdefault((fault.sensor, fault.start), []).append(fault)
    found = [_soonest(together) for together in failures.values()]
    isolated = [
        min((f.time_to_isolate for f in together if f.time_to_isolate is not None), default=None)
        for together in failures.values()
    ]
    if len(failures) == 1:
        labels = {test.name: test.label for test in description.tests}
        order = sorted(found[0], key=lambda n: found[0][n])
        later = "".join(f"; {labels[n]} {found[0][n]:g} s" for n in order[1:3])
        note = f"{labels[order[0]]}{later}" if order else "not noticed yet"
        first = found[0][order[0]] if order else None
        return [
            Headline(label="Fault found after", value=first, unit="s", note=note),
            Headline(label="Isolated after", value=isolated[0], unit="s", note=whom),
        ]
    seen = [min(delays.values()) for delays in found if delays]
    note = f"the slowest after {max(seen):g} s" if seen else "none noticed yet"
    count = float(sum(delay is not None for delay in isolated))
    return [
        Headline(label=f"Faults found, of {len(failures)}", value=float(len(seen)), unit="", note=note),
        Headline(label=f"Isolated, of {len(failures)}", value=count, unit="", note=whom),
    ]


def _soonest(faults: Sequence[FaultScore]) -> dict[str, float]:
    """Test -> delay of its first alarm at any of these faults."""
    delays: dict[str, float] = {}
    for fault in faults:
        for name, delay in fault.time_to_alarm.items():
            if delay is not None:
                delays[name] = min(delay, delays.get(name, delay))
    return delays
