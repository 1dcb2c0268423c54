"""A flight that is written by hand: who alarmed, who was isolated and which fault acted when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore import Fault
from ftcore.description import Channel, Signal, Subsystem, SystemDescription
from ftcore.description import Test as DeclaredTest
from ftcore.events import Event
from ftcore.faults import ALL_KINDS, Acted, ChannelAddress
from ftcore.recording import Recording
from ftcore.score import Book, Score, compute

AIDS = ("gps", "cns", "altimeter")
GYROS = ("imu.gyro", "imu.gyro.1", "imu.gyro.2", "imu.gyro.3")
SATELLITES = ("gps", "gps.C1", "gps.C2")
TESTS = (
    DeclaredTest(
        name="residual",
        label="residual test",
        subjects=AIDS,
        dof="1",
        source="tests",
        probability="exact",
        reference=("imu",),
    ),
    DeclaredTest(name="parity", label="parity test", subjects=GYROS, dof="1", source="tests", probability="exact"),
    DeclaredTest(
        name="satellite", label="satellite test", subjects=SATELLITES, dof="1", source="tests", probability="exact"
    ),
    DeclaredTest(
        name="old",
        label="old filter's test",
        subjects=("cns",),
        dof="1",
        source="tests",
        probability="exact",
        baseline=True,
    ),
)
USED = ("gps", "cns", "altimeter", "imu.gyro.1", "imu.gyro.2", "imu.gyro.3", "gps.C1", "gps.C2")
CHANNELS = {
    "gps.position.all": "gps",
    "gps.pseudorange.C1": "gps",
    "cns.attitude.roll": "cns",
    "altimeter.height.up": "altimeter",
    "imu.gyro.1x": "imu.gyro.1",
    "imu.gyro.3x": "imu.gyro.3",
}
RECOVERY = 10.0


def _parts(name: str) -> tuple[int, ...]:
    return (0, 1) if name.endswith(".all") else (0,)


DESCRIPTION = SystemDescription(
    id="synthetic",
    title="",
    summary="",
    source="tests",
    epoch=1.0,
    channels=tuple(
        Channel(
            name=name,
            label=name,
            unit="m",
            sensor=sensor,
            group=name.rpartition(".")[0],
            parts=_parts(name),
            kinds=ALL_KINDS,
            typical=1.0,
        )
        for name, sensor in CHANNELS.items()
    ),
    subsystems=(Subsystem(name="gps", label="GPS"), Subsystem(name="cns", label="Star tracker")),
    estimators={},
    tests=TESTS,
    signals=tuple(
        Signal(name=name, label=name, unit="1", group="")
        for name in (
            *(f"test.{t.name}.{s}.{what}" for t in TESTS for s in t.subjects for what in ("statistic", "alarm")),
            *(f"used.{s}" for s in USED),
        )
    ),
    charts=(),
    blocks=(),
    wires=(),
    scene=(),
    settings_schema={},
    parameters_schema={},
    recovery=RECOVERY,
)
ADDRESSES = {c.name: ChannelAddress(c.name, c.group, c.parts, c.unit, c.kinds, c.sensor) for c in DESCRIPTION.channels}

Spans = Mapping[tuple[int, str], Sequence[tuple[float, float]]]
"""(run, subject) -> from when to when, the end excluded."""


class Flight:
    """A flight of 1 Hz that is written by hand: who alarmed and who was isolated when, and which faults acted when."""

    def __init__(self, seconds: int = 100, runs: int = 1) -> None:
        self.time = np.arange(1.0, seconds + 1)
        self.runs = runs
        self.alarms: dict[tuple[str, str], NDArray[np.bool_]] = {}
        self.out: dict[str, NDArray[np.bool_]] = {}
        self.faults: list[Fault] = []
        self.acted: dict[str, Acted] = {}

    def alarm(self, test: str, subject: str, start: float, end: float, run: int = 0) -> Flight:
        flags = self.alarms.setdefault((test, subject), np.zeros((len(self.time), self.runs), bool))
        flags[(self.time >= start) & (self.time < end), run] = True
        return self

    def isolate(self, subject: str, start: float, end: float, run: int = 0) -> Flight:
        flags = self.out.setdefault(subject, np.zeros((len(self.time), self.runs), bool))
        flags[(self.time >= start) & (self.time < end), run] = True
        return self

    def fault(
        self, channel: str, start: float, end: float | None = None, first: Sequence[float] | None = None
    ) -> Flight:
        """A fault; ``first`` is when it first acts in each run (NaN: never), its start if that is not said."""
        id = f"f{len(self.faults) + 1}"
        self.faults.append(Fault(id=id, channel=channel, kind="bias", magnitude=1.0, start=start, end=end))
        began = np.full(self.runs, start) if first is None else np.array(first, float)
        over = np.where(np.isnan(began), np.nan, self.time[-1] if end is None else end - 1.0)
        epochs = np.nan_to_num(over - began + 1).astype(np.int64)
        self.acted[id] = Acted(began, over, epochs, over == self.time[-1])
        return self

    def score(self, **more: Any) -> Score:
        """Scored as a simulation would score it."""
        return compute(self.book(), self._events(), self.faults, DESCRIPTION, ADDRESSES, self.acted, **more)

    def score_of(self, runs: Sequence[int]) -> Score:
        """Scored as if only these runs, one after the other, had been flown."""
        first, places = runs[0], np.array(runs)
        assert list(runs) == list(range(first, first + len(runs)))
        events = [e for e in self._events() if e.run in runs]
        acted = {
            id: replace(a, first=a.first[places], last=a.last[places], epochs=a.epochs[places], now=a.now[places])
            for id, a in self.acted.items()
        }
        book = self.book().of_runs(places)
        return compute(book, events, self.faults, DESCRIPTION, ADDRESSES, acted, first_run=first)

    def book(self) -> Book:
        """What the score needs of the recording."""
        recording = Recording(DESCRIPTION.signals, self.runs, 1.0)
        rows = np.zeros((len(self.time), self.runs, len(DESCRIPTION.signals)))
        for (test, subject), flags in self.alarms.items():
            rows[:, :, recording.column[f"test.{test}.{subject}.alarm"]] = flags
        for subject in USED:
            out = self.out.get(subject, np.zeros(rows.shape[:2], bool))
            rows[:, :, recording.column[f"used.{subject}"]] = ~out
        for time, row in zip(self.time, rows, strict=True):
            recording.append(time, row)
        return Book.of(recording, DESCRIPTION)

    def _events(self) -> list[Event]:
        raw: list[tuple[float, int, str, str, dict[str, object]]] = []
        for (test, subject), flags in self.alarms.items():
            raw += [(*e, subject, {"test": test}) for e in self._edges(flags, "test.alarmed", "test.cleared")]
        for subject, flags in self.out.items():
            raw += [(*e, subject, {}) for e in self._edges(flags, "subsystem.isolated", "subsystem.readmitted")]
        raw.sort(key=lambda e: e[0])
        return [Event(index=i, time=t, run=r, kind=k, subject=s, detail=d) for i, (t, r, k, s, d) in enumerate(raw)]

    def _edges(self, flags: NDArray[np.bool_], up: str, down: str) -> list[tuple[float, int, str]]:
        before = np.vstack([np.zeros((1, self.runs), bool), flags[:-1]])
        return [
            (float(self.time[i]), int(run), up if flags[i, run] else down)
            for i, run in zip(*np.nonzero(flags != before), strict=True)
        ]
