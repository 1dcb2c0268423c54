"""Random schedules of faults for every system: drawn from a number, flown through the public interface, judged.

A schedule is a scenario. Its number alone decides every choice of the settings (driving tests, masters, modes) and one
to four faults of random channels, kinds and sizes: one alone, several at once, overlapping, or the same one returning.
All of them end, and a minute of flight follows. Then

* everybody who was used before the first fault is used again (no lock-out),
* every number of the fault-tolerant estimate was finite all the time (no NaN),
* each error of it lies inside SIGMAS of its own sigma.

An error is judged by its median over the last WINDOW seconds. A sound filter's errors hardly change in that time, so
each of at most nine axes of a schedule leaves 4 sigma with a probability of 6e-5, and one of 300 schedules has such an
axis with a probability below 0.16; the seeds are fixed, so it happens always or never.

By hand: ``python -m tests.papers.schedules SYSTEM [FIRST [COUNT]]`` prints those that fail, and how many.
"""

from __future__ import annotations

import math
import sys
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from ftcore import Fault, Scenario, Simulation
from ftcore.description import Channel
from ftcore.systems.registry import SYSTEMS
from tests.settings import that_matter

SIGMAS = 4.0
WINDOW = 10.0
AFTER = 60.0
"""Seconds of flight after the last fault."""


@dataclass(frozen=True)
class Kind:
    """How a system's schedules are drawn, and what is judged.

    Attributes:
        begin, latest, shortest, longest: seconds: the first fault begins from begin to latest; how long faults last.
        typical: seconds in which a ramp or a random walk grows to its channel's typical size.
        estimator: whose errors are judged.
        unguarded: settings that leave somebody unwatched on purpose: nothing can be demanded of them.
        alternatives: parameters to draw from besides.
    """

    begin: float
    latest: float
    shortest: float
    longest: float
    typical: float
    estimator: str
    unguarded: frozenset[tuple[str, object]] = frozenset()
    alternatives: tuple[Mapping[str, object], ...] = ({},)


REDUNDANT: Mapping[str, object] = {"inertial": {"configuration": "redundant"}}
KINDS = {
    "sins-gps-doppler": Kind(
        30.0,
        60.0,
        2.0,
        40.0,
        10.0,
        "fused",
        frozenset({("driving_test", "none"), ("imu_driving_test", "none"), ("altimeter_driving_test", "none")}),
    ),
    "gps-receiver": Kind(20.0, 40.0, 2.0, 30.0, 10.0, "combined"),
    "redundant-imu": Kind(1.0, 8.0, 0.3, 8.0, 2.0, "protected", frozenset({("driving_test", "none")})),
    "sins-gps-bd2-cns": Kind(
        40.0,
        70.0,
        2.0,
        40.0,
        20.0,
        "fused",
        frozenset({("driving_test", "none"), ("imu_driving_test", "none"), ("recovery", "none")}),
        ({}, REDUNDANT),
    ),
}


def draw(system: str, number: int) -> Scenario:
    """Schedule ``number`` of a system: the same for ever."""
    kind, description = KINDS[system], SYSTEMS[system].description
    address = [2026, list(KINDS).index(system), number]
    rng = np.random.default_rng(address)
    settings = {}
    for name, field in description.settings_schema["properties"].items():
        choices = field.get("enum", [False, True] if field.get("type") == "boolean" else [])
        choices = [c for c in choices if (name, c) not in kind.unguarded]
        if choices:
            # Each setting has its own address: a new one changes nothing of the others, nor of the faults.
            own = np.random.default_rng([*address, zlib.crc32(name.encode())])
            settings[name] = choices[int(own.integers(len(choices)))]
    parameters = kind.alternatives[int(rng.integers(len(kind.alternatives)))]
    faults = _faults(rng, kind, _families(system, kind.alternatives.index(parameters)))
    return Scenario.model_validate(
        {
            "id": f"schedule-{number}",
            "title": f"schedule {number}",
            "system": system,
            "seed": number,
            "duration": math.ceil(max(f.end or 0.0 for f in faults) + AFTER),
            "parameters": parameters,
            "settings": that_matter(system, parameters, settings),
            "faults": [f.model_dump(exclude_none=True) for f in faults],
        }
    )


@cache
def _families(system: str, alternative: int) -> tuple[tuple[Channel, ...], ...]:
    """Channels that can act, by kind of quantity: so many satellites do not crowd out the one altimeter."""
    kind = KINDS[system]
    parameters = dict(kind.alternatives[alternative])
    calm = Simulation(Scenario(system=system, duration=1.0, parameters=parameters)).step()
    absent = set(calm.unavailable)
    for stem in ("elevation", "discrepancy.gps"):
        absent |= {
            f"gps.{quantity}.{name.removeprefix(stem + '.')}"
            for name in calm.signals
            if name.startswith(stem + ".") and not np.isfinite(calm[name]).all()
            for quantity in ("pseudorange", "delta_range")
        }
    families: dict[str, list[Channel]] = {}
    for channel in calm.description.channels:
        watched = "configuration" not in str(KINDS[system].alternatives) or parameters or channel.group[:3] != "imu"
        # Who flies on three axes alone has nothing to compare them with; and nothing tells all axes from a rotation.
        if channel.name not in absent and watched and channel.name[:3] + channel.name[-3:] != "imuall":
            families.setdefault(channel.name.rpartition(".")[0], []).append(channel)
    return tuple(tuple(f) for f in families.values())


def _faults(rng: np.random.Generator, kind: Kind, families: tuple[tuple[Channel, ...], ...]) -> list[Fault]:
    pattern = str(rng.choice(["one", "at once", "overlapping", "returning"], p=[0.15, 0.3, 0.25, 0.3]))
    start = float(rng.uniform(kind.begin, kind.latest))
    if pattern == "returning":
        again = int(rng.integers(2, 4))
        first = _fault(rng, kind, families, start)
        faults = [first]
        for _ in range(again - 1):
            gap = float(rng.uniform(0.1, 0.5)) * kind.longest
            begin = round((faults[-1].end or 0.0) + gap, 2)
            length = (first.end or 0.0) - (first.start or 0.0)
            faults.append(first.model_copy(update={"start": begin, "end": round(begin + length, 2)}))
        if rng.random() < 0.5:
            faults.append(_fault(rng, kind, families, float(rng.uniform(start, faults[-1].end or start))))
        return faults
    count = 1 if pattern == "one" else int(rng.integers(2, 5))
    together = pattern == "at once"
    starts = [start if together else start + float(rng.uniform(0.0, kind.longest)) for _ in range(count)]
    return [_fault(rng, kind, families, s) for s in starts]


def _fault(rng: np.random.Generator, kind: Kind, families: tuple[tuple[Channel, ...], ...], start: float) -> Fault:
    """From what nobody can see to what nobody can miss: a third of the typical size to thirty times it."""
    family = families[int(rng.integers(len(families)))]
    channel = family[int(rng.integers(len(family)))]
    what = str(rng.choice(sorted(channel.kinds)))
    size = channel.typical * float(np.exp(rng.uniform(np.log(0.3), np.log(30.0)))) * float(rng.choice([-1.0, 1.0]))
    fields: dict[str, float] = {}
    if what in ("bias", "sine", "outliers"):
        fields["magnitude"] = size
    elif what == "noise":
        fields["magnitude"] = abs(size)
    elif what == "ramp":
        fields["magnitude"] = size / kind.typical
    elif what == "random-walk":
        fields["magnitude"] = abs(size) / math.sqrt(kind.typical)
    elif what == "scale-factor":
        fields["magnitude"] = float(10.0 ** rng.uniform(-3.0, 0.0)) * float(rng.choice([-1.0, 1.0]))
    elif what == "delay":
        fields["magnitude"] = float(rng.uniform(0.1, 5.0))
    if what == "sine":
        fields["angular_frequency"] = float(np.exp(rng.uniform(np.log(0.02), np.log(2.0))))
    if what == "outliers":
        fields["rate"] = float(rng.uniform(0.05, 1.0))
    length = float(np.exp(rng.uniform(np.log(kind.shortest), np.log(kind.longest))))
    rounded = {name: float(f"{value:.3g}") for name, value in fields.items()}
    end = round(start + length, 2)
    return Fault.model_validate({"channel": channel.name, "kind": what, "start": round(start, 2), "end": end} | rounded)


@dataclass(frozen=True)
class Finding:
    """What came of a schedule; fine if nobody is locked out and nothing stopped it, and its sigmas are few.

    Attributes:
        locked: who was used before the first fault and is not a minute after the last one.
        worst: largest error over its sigma at the end, and of which signal.
        broken: what else was wrong: signals that were not finite, or the error that ended the flight.
    """

    scenario: Scenario
    locked: tuple[str, ...]
    worst: tuple[float, str]
    broken: str = ""

    @property
    def fine(self) -> bool:
        """Whether all three demands are met."""
        return not self.locked and not self.broken and self.worst[0] <= SIGMAS

    def __str__(self) -> str:
        """What was wrong, and how to fly it again."""
        words = [f"locked out {', '.join(self.locked)}"] * bool(self.locked) + [self.broken] * bool(self.broken)
        words.append(f"{self.worst[1]} at {self.worst[0]:.1f} sigma")
        return "; ".join(words) + "\n    " + self.scenario.model_dump_json(exclude_defaults=True)


def fly(system: str, number: int) -> Finding:
    """Draw, fly and judge one schedule."""
    scenario = draw(system, number)
    kind = KINDS[system]
    try:
        sim = Simulation(scenario).advance()
    except Exception as error:
        return Finding(scenario, (), (math.inf, "the flight"), f"ended by {type(error).__name__}: {error}")
    names = [n for n in sim.signals if n.startswith(f"{kind.estimator}.error.")]
    gaps = [n for n in names if not np.isfinite(sim[n]).all()]
    late = sim.time > scenario.duration - WINDOW
    before = sim.time < min(f.start or 0.0 for f in scenario.faults)
    locked = []
    for name in sim.signals:
        if name.startswith(("used.", "validity.")) and sim[name][before].mean() > 0.9:
            subject = name.partition(".")[2]
            here = sim[f"elevation.{subject[4:]}"][late] if f"elevation.{subject[4:]}" in sim.signals else 1.0
            if sim[name][late].mean() < 0.5 and np.all(np.nan_to_num(here) > math.radians(6.0)):
                locked.append(name)
    worst = max(_sigmas(sim, names, late))
    broken = f"not finite: {', '.join(gaps)}" if gaps else ""
    return Finding(scenario, tuple(locked), worst, broken)


def _sigmas(sim: Simulation, names: Iterable[str], late: np.ndarray) -> Iterable[tuple[float, str]]:
    """Errors over their sigmas: the estimate's own; the rates of three sound gyros are solved with sigma / sqrt(2)."""
    for name in names:
        sigma = name.replace(".error.", ".sigma.")
        if sigma in sim.signals:
            yield _largest(sim[name][late] / sim[sigma][late]), name
        elif ".error.rate." in name:
            yield _largest(sim[name][late] / (0.01 / math.sqrt(2.0))), name


def _largest(ratio: np.ndarray) -> float:
    return float(np.median(np.abs(ratio))) if np.isfinite(ratio).all() else math.inf


def worst(findings: Iterable[Finding], count: int = 10) -> str:
    """The worst of them, one after the other, with what flies each again."""
    order = sorted(findings, key=lambda f: (f.fine, not f.broken, -len(f.locked), -f.worst[0]))
    return "\n".join(str(finding) for finding in order[:count])


def _main(system: str, first: int = 0, count: int = 30) -> None:
    found = []
    for number in range(first, first + count):
        found.append(fly(system, number))
        if not found[-1].fine:
            print(found[-1], flush=True)
    locked, far = sum(bool(f.locked) for f in found), sum(f.worst[0] > SIGMAS for f in found)
    wrong = sum(not f.fine for f in found)
    print(f"{system} {first} to {first + count - 1}: {wrong} of {count} wrong; {locked} locked out, {far} beyond sigma")


if __name__ == "__main__":
    _main(sys.argv[1], *map(int, sys.argv[2:4]))
