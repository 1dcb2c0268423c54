"""Stated against measured: how often every test of every system alarms in flights in which nothing fails.

    python -m tests.papers.probabilities            the table, as Markdown (docs/probabilities.md is this)
    python -m tests.papers.probabilities --runs 20  a quicker, coarser one; 400 a night's, with intervals half as wide
    python -m tests.papers.probabilities --system redundant-imu      of one system

Each system flies its paper's scenario without faults three times, with a false-alarm probability of 0.1, 0.01 and
0.001. Where a setting can, no test decides anything, so that one false alarm is not the cause of the next.

The interval holds the true rate with 95 %. It is Clopper's and Pearson's, exact for independent epochs. Where alarms of
a run come together, runs are the independent units: the variance of a run's count over that of a binomial one is the
design effect; the interval is that of as many epochs, and as many alarms, fewer. The table says where. A handful of
alarms does not tell how they come together, so a test's design effect is the largest that is found at its three levels.

One rule says what may be declared. Exact: theory says that the statistic has the distribution that the threshold is
taken from, and the interval holds the stated probability at every level. Bounded: theory says that it is no larger, and
no interval lies above. Approximate: neither is known; the note says by how much it is off. What the table contradicts
it marks with a dagger.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from ftcore import Scenario, Simulation, catalogue
from ftcore.description import Probability, Test

Array = NDArray[np.float64]
LEVELS = (0.1, 0.01, 1e-3)
TOGETHER = 1.3
"""A design effect from which on epochs are not called independent."""


@dataclass(frozen=True)
class Flown:
    """How a system is flown: scenario, parameters and settings over its own, the tests that count, and runs."""

    scenario: str
    runs: int
    duration: float
    parameters: dict[str, object]
    settings: dict[str, object]
    tests: str = ""
    seed: int = 2026


FLIGHTS = (
    Flown(
        "zhang-1992",
        50,
        100.0,
        {},
        {"driving_test": "none", "imu_driving_test": "none", "altimeter_driving_test": "none"}
        | {"satellite_integrity": "snapshot"},
    ),
    Flown("chey-2004", 100, 100.0, {}, {}),
    Flown("kim-2005", 40, 15.0, {}, {"driving_test": "none"}),
    Flown("yang-2016-scenario-1", 36, 330.0, {}, {}, tests="two-propagator"),
    Flown(
        "yang-2016-scenario-1",
        24,
        330.0,
        {"inertial": {"configuration": "redundant"}},
        {"imu_driving_test": "none"},
        tests="parity|glt",
    ),
)


@dataclass(frozen=True)
class Measured:
    """Alarms of a test on a subject, or on all parts of one, at one stated probability."""

    system: str
    test: Test
    subject: str
    level: float
    alarms: int
    epochs: int
    effect: float

    @property
    def rate(self) -> float:
        """Share of epochs with an alarm."""
        return self.alarms / self.epochs

    def interval(self, outside: float = 0.05) -> tuple[float, float]:
        """Limits of the rate; see the module."""
        return clopper_pearson(self.alarms / self.effect, self.epochs / self.effect, outside)


def clopper_pearson(alarms: float, epochs: float, outside: float) -> tuple[float, float]:
    """Exact limits of a binomial probability; counts may be fractions."""
    low = float(beta.ppf(outside / 2, alarms, epochs - alarms + 1)) if alarms > 0 else 0.0
    high = float(beta.ppf(1 - outside / 2, alarms + 1, epochs - alarms)) if alarms < epochs else 1.0
    return low, high


def design_effect(alarms: Array, tested: Array) -> float:
    """Variance of a run's alarms ``(runs,)`` over a binomial one's, 1 at least; ``tested (runs,)`` epochs."""
    rate = alarms.sum() / tested.sum()
    expected = rate * tested
    variance = float(np.square(alarms - expected).sum() / (len(alarms) - 1))
    return max(1.0, variance / max(float(expected.mean() * (1.0 - rate)), 1e-300))


def measure(flown: Flown, level: float, runs: int | None = None) -> list[Measured]:
    """Fly and count."""
    ready = Scenario.load(flown.scenario)
    settings = ready.settings | flown.settings | {"false_alarm_probability": level}
    if ready.system == "sins-gps-bd2-cns":
        settings["doubt_probability"] = min(0.9, 10.0 * level if level < 0.09 else 0.2)
    changes = {
        "faults": (),
        "duration": flown.duration,
        "settings": settings,
        "parameters": ready.parameters | flown.parameters,
    }
    sim = Simulation(ready.model_copy(update=changes), runs=runs or flown.runs, seed=flown.seed).advance()
    found = []
    for test in sim.description.tests:
        if not re.match(flown.tests, test.name):
            continue
        for name, subjects in grouped(test):
            parts = [f"test.{test.name}.{s}" for s in subjects]
            tested = sum(((sim[f"{p}.dof"] > 0) & np.isfinite(sim[f"{p}.statistic"])).sum(axis=0) for p in parts)
            alarms = sum((sim[f"{p}.alarm"] > 0).sum(axis=0) for p in parts)
            flew = np.asarray(tested, dtype=np.float64)
            if flew.sum():
                counted = np.asarray(alarms, dtype=np.float64)
                effect = design_effect(counted, flew)
                found.append(Measured(ready.system, test, name, level, int(counted.sum()), int(flew.sum()), effect))
            else:
                found.append(Measured(ready.system, test, name, level, 0, 0, 1.0))
    return found


def grouped(test: Test) -> Iterator[tuple[str, list[str]]]:
    """Subjects of a test as the table has them: each by itself, parts of one (instruments, satellites) together."""
    parts: dict[str, list[str]] = {}
    for subject in test.subjects:
        whole = test.whole_of(subject)
        parts.setdefault(subject if whole is None else f"{whole}, one part", []).append(subject)
    yield from parts.items()


def everything(runs: int | None = None, system: str | None = None) -> list[Measured]:
    """All systems (or one), all levels."""
    chosen = [f for f in FLIGHTS if system in (None, Scenario.load(f.scenario).system)]
    return [m for flown in chosen for m in together([measure(flown, level, runs) for level in LEVELS])]


def together(levels: list[list[Measured]]) -> list[Measured]:
    """The same, each with the largest design effect that its test has at any level."""
    return [
        replace(m, effect=max(found[k].effect for found in levels))
        for measured in levels
        for k, m in enumerate(measured)
    ]


def contradicts(m: Measured, kind: Probability, outside: float = 0.05) -> bool:
    """Whether the measured rate is not what is declared."""
    low, high = m.interval(outside)
    return m.epochs > 0 and (low > m.level or (kind == "exact" and high < m.level))


def table(found: list[Measured]) -> str:
    """The table in Markdown."""
    lines = []
    for system in dict.fromkeys(m.system for m in found):
        description = catalogue.system(system)
        lines += ["", f"## {description.title}", ""]
        lines += ["| Test | Subject | Declared | at 0.1 | at 0.01 | at 0.001 | Epochs |", "|" + "---|" * 7]
        rows: dict[tuple[str, str], list[Measured]] = {}
        for m in found:
            if m.system == system:
                rows.setdefault((m.test.name, m.subject), []).append(m)
        for (_, subject), levels in rows.items():
            test = levels[0].test
            kind = test.probability_of(subject.split(",")[0] if "," not in subject else part_of(test, subject))
            cells = [cell(m) + ("†" if kind != "approximate" and contradicts(m, kind) else "") for m in levels]
            epochs = (
                " / ".join(f"{m.epochs:,}" for m in levels)
                if len({m.epochs for m in levels}) > 1
                else (f"{levels[0].epochs:,}")
            )
            lines.append(f"| {test.label} | {subject} | {kind} | {' | '.join(cells)} | {epochs} |")
        notes = [f"- {t.label}: {t.probability}; {t.probability_note}" for t in description.tests if t.probability_note]
        lines += ["", *notes] if notes else []
    return "\n".join(lines)


def part_of(test: Test, subject: str) -> str:
    """The first part that a group stands for."""
    whole = subject.removesuffix(", one part")
    return next(s for s in test.subjects if test.whole_of(s) == whole)


def cell(m: Measured) -> str:
    """Measured rate over the stated one, with its interval; a star where alarms come together."""
    if not m.epochs:
        return "not asked"
    low, high = m.interval()
    star = "\\*" if m.effect > TOGETHER else ""
    return f"{m.rate / m.level:.2f} ({low / m.level:.2f} to {high / m.level:.2f}){star}"


HEAD = """# Stated and measured false-alarm probabilities

Made by `make probabilities` (`python -m tests.papers.probabilities`). Each cell is the measured share of epochs with an
alarm, divided by the false-alarm probability that was set: 1 is what was stated. In brackets its 95 % interval. A star:
alarms of a run come together, so the interval counts runs, not epochs (design effect above 1.3, the largest of the
three levels: a handful of alarms does not tell how they come together). "One part": all instruments, or all satellites,
counted together; a part alarms where the test of the whole does and names it.

What a test declares is shown where its threshold is shown, by one rule. *Exact*: theory says that the statistic has the
distribution that the threshold is taken from, and the interval holds the stated probability. *Bounded*: theory says
that the rate is no larger, and no interval lies above. *Approximate*: it depends on how well a model fits; the note
says by how much it is off. A dagger marks a cell that contradicts what is declared; of 100 cells of sound tests about
five do by chance."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=None, help="runs of each flight, instead of the table's own")
    parser.add_argument("--system", choices=[s.id for s in catalogue.systems()], help="only this system")
    asked = parser.parse_args()
    print(HEAD)
    print(table(everything(asked.runs, asked.system)))


if __name__ == "__main__":
    main()
