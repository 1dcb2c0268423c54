"""Rejection must not feed itself (issue 5, 3): after any fault or several, everybody is back within a minute.

A hundred random schedules, each a flight of its own under high manoeuvre, where the inertial model is at its worst: one
to three aids, each with a fault of a random kind, size, onset and length, so that they overlap or follow one another.
A batch shares its faults, so every schedule is a single run with the noise and the sensors of its own seed.

Measured over the hundred: GPS is back after 17 s at most, BD2 after 22 s, the star tracker after 35 s; the fused
position is never further off than 4.9 m from a minute after the last fault on.

An aid is back when ten seconds begin in which it is believed by half or more on average. Chance keeps a sound aid out
of that with a probability far below 1e-6: its validity is below one in a tenth of the epochs, and zero in a hundredth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from ftcore import Fault, Scenario, Simulation

AIDS = {"gps": ("gps.position.all", 1.0), "bd2": ("bd2.position.all", 1.0), "cns": ("cns.attitude.all", 5.0)}
"""Channel of each aid, and what the sizes below are multiplied by: metres, and five arcseconds."""
KINDS = ("bias", "ramp", "sine", "noise", "stuck", "dropout", "outliers", "random-walk")
BEGIN, LATEST, SHORTEST, LONGEST = 120.0, 90, 20, 180
"""Faults begin from BEGIN to BEGIN + LATEST and last from SHORTEST to LONGEST [s]."""
WITHIN, STRETCH, AFTER = 60, 10, 120
SCHEDULES = 100


def fault(rng: np.random.Generator, aid: str) -> Fault:
    """A random fault of an aid: from what nobody can see to what nobody can miss."""
    channel, unit = AIDS[aid]
    kind = str(rng.choice(KINDS))
    start = BEGIN + float(rng.integers(0, LATEST))
    fields: dict[str, float] = {}
    if kind in ("bias", "sine", "noise"):
        fields["magnitude"] = unit * float(rng.uniform(5.0, 30.0))
    elif kind == "outliers":
        fields["magnitude"], fields["rate"] = unit * float(rng.uniform(20.0, 100.0)), float(rng.uniform(0.1, 1.0))
    elif kind in ("ramp", "random-walk"):
        fields["magnitude"] = unit * float(np.exp(rng.uniform(np.log(0.05), np.log(2.0))))
    if kind == "sine":
        fields["angular_frequency"] = float(np.exp(rng.uniform(np.log(0.02), np.log(0.2))))
    end = start + float(rng.integers(SHORTEST, LONGEST))
    return Fault(channel=channel, kind=kind, start=start, end=end, **fields)


def schedule(k: int) -> list[Fault]:
    """Which aids fail, at least one, and how."""
    rng = np.random.default_rng([2016, k])
    failing: list[str] = []
    while not failing:
        failing = [aid for aid in AIDS if rng.random() < 0.6]
    return [fault(rng, aid) for aid in failing]


@dataclass(frozen=True)
class Aftermath:
    """What came after the last fault of a schedule: seconds until each aid was back, and the worst horizontal error
    from a minute after it on [m]."""

    faults: tuple[Fault, ...]
    back: dict[str, float]
    error: float


@cache
def flown(k: int) -> Aftermath:
    """Schedule k."""
    faults = schedule(k)
    end = max(f.end for f in faults if f.end is not None)
    ready = Scenario.load("yang-2016-scenario-1")
    update = {"seed": k, "duration": end + AFTER, "faults": tuple(faults)}
    sim = Simulation(ready.model_copy(update=update)).advance()
    later = sim.time > end
    back = {}
    for aid in AIDS:
        mean = np.convolve(sim[f"validity.{aid}"][later, 0], np.full(STRETCH, 1.0 / STRETCH), mode="valid")
        back[aid] = float(np.argmax(mean >= 0.5)) if (mean >= 0.5).any() else np.inf
    error = sim["fused.error.position.horizontal"][sim.time > end + WITHIN, 0]
    return Aftermath(tuple(faults), back, float(error.max()))


def late(numbers: range, aids: tuple[str, ...]) -> list[str]:
    """Schedules in which one of these aids is not back in time, in words."""
    found = []
    for k in numbers:
        after = flown(k)
        if max(after.back[aid] for aid in aids) > WITHIN:
            words = [f"{f.channel} {f.kind} {f.magnitude} {f.start:g}-{f.end:g} s" for f in after.faults]
            found.append(f"schedule {k}: back after {after.back}; {'; '.join(words)}")
    return found


def test_schedules_are_of_every_sort():
    """Every kind, every aid, one to three at a time."""
    all_of_them = [schedule(k) for k in range(SCHEDULES)]
    assert {f.kind for faults in all_of_them for f in faults} == set(KINDS)
    assert {len(faults) for faults in all_of_them} == {1, 2, 3}


@pytest.mark.long
def test_given_random_faults_ended_then_everybody_is_back_within_a_minute():
    assert not late(range(4), tuple(AIDS))


@pytest.mark.long
@pytest.mark.timeout(1500)
def test_given_any_of_100_schedules_ended_then_everybody_is_back_within_a_minute():
    assert not late(range(SCHEDULES), tuple(AIDS))


@pytest.mark.long
@pytest.mark.timeout(1500)
def test_given_any_of_100_schedules_ended_then_the_fused_position_is_good_a_minute_later():
    """Sound aids fused are good to half a metre; 6 m is two standard deviations of one fix."""
    assert max(flown(k).error for k in range(SCHEDULES)) < 6.0
