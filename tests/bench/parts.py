"""Where an epoch's time goes: a sampling profiler that knows the floors of the house.

Every few milliseconds of processor time the call stack is looked at. Going inwards from `Simulation.step`, the first
frame that a rule knows names the part, so a Kalman update that a test asks for belongs to the test. The rules go by
floors and by names that every system has; nothing is wrapped, so nothing is slowed.
"""

from __future__ import annotations

import signal
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from ftcore import Scenario, Simulation
from tests.bench.flights import BATCH, fly

INTERVAL = 0.001
"""Seconds of processor time asked for between two looks; the kernel's tick makes it 4 ms where it ticks at 250 Hz."""

RULES: tuple[tuple[str, str, str], ...] = (
    ("ftcore.systems.", ".plant", "plant"),
    ("ftcore.world.", "", "plant"),
    ("ftcore.sensors.", "", "plant"),
    ("ftcore.faults", "", "faults"),
    ("ftcore.systems.", ".imu", "imu fdi"),
    ("ftcore.detection.parity", "", "imu fdi"),
    ("ftcore.estimation.strapdown", "", "strapdown"),
    ("ftcore.estimation.ins_error", "", "error model"),
    ("ftcore.systems.", "tests", "tests"),
    ("ftcore.detection.", "", "tests"),
    ("ftcore.systems.", ".reporter", "reporter"),
    ("ftcore.systems.", ".bank", "filters"),
    ("ftcore.estimation.", "", "filters"),
    ("ftcore.recording", "", "recording and events"),
    ("ftcore.events", "", "recording and events"),
)
"""(module begins with, module ends with, part), the first that fits; of a stack the outermost frame that fits any."""

ORDER = (
    "plant",
    "faults",
    "imu fdi",
    "strapdown",
    "error model",
    "filters",
    "tests",
    "navigator, rest",
    "reporter",
    "recording and events",
)


def part_of(frame: FrameType | None) -> str:
    """The part that a stack is in."""
    stack = []
    while frame is not None:
        stack.append((str(frame.f_globals.get("__name__", "")), frame.f_code.co_name))
        frame = frame.f_back
    inside = "recording and events"
    for module, function in reversed(stack):
        if (module, function) == ("ftcore.estimation.kalman", "innovation"):
            return "tests"  # a measurement that is compared and not taken in
        for begins, ends, part in RULES:
            if module.startswith(begins) and module.endswith(ends):
                return part
        if module.startswith("ftcore.systems."):
            inside = "navigator, rest"
    return inside


@contextmanager
def watching() -> Iterator[Counter[str]]:
    """Count looks by part while the block runs."""
    seen: Counter[str] = Counter()

    def look(_: int, frame: FrameType | None) -> None:
        seen[part_of(frame)] += 1

    before = signal.signal(signal.SIGPROF, look)
    signal.setitimer(signal.ITIMER_PROF, INTERVAL, INTERVAL)
    try:
        yield seen
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def cost_by_part(scenario: Scenario, runs: int, least_seconds: float = 2.0) -> dict[str, float]:
    """Milliseconds of processor time of one epoch, by part; flown again and again for `least_seconds`."""
    Simulation(scenario, runs=runs).advance(epochs=2)
    epochs, start = 0, time.process_time()
    with watching() as seen:
        while time.process_time() - start < least_seconds:
            epochs += fly(scenario, runs).epoch
    each = 1e3 * (time.process_time() - start) / epochs
    total = sum(seen.values())
    return {part: each * seen[part] / total for part in ORDER}


def both(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Part -> milliseconds of an epoch of one run, and of a batch of runs; parts that the system has."""
    one, many = cost_by_part(scenario, 1), cost_by_part(scenario, BATCH)
    return {part: (one[part], many[part]) for part in ORDER if one[part] or many[part]}
