"""Phases of high and of low manoeuvre, made of the segments of :mod:`ftcore.world.trajectory`.

Yang 2016 flies an hour of them (section 4): it says which minutes are under high and which under low manoeuvre, and
leaves open how hard the aircraft turns. A phase here repeats a pattern of turns, climbs and speed changes until its
time is over, and closes with straight flight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle
from typing import Literal

from ftcore import earth
from ftcore.world.trajectory import Climb, Hold, Segment, SpeedChange, Straight, Turn

Intensity = Literal["high", "low"]


def phase(intensity: Intensity, seconds: float, speed: float, bank: float) -> list[Segment]:
    """Segments of one phase, ``seconds`` long.

    Args:
        intensity: which pattern: ``high`` turns by right angles and more with little rest between, ``low`` turns gently
            now and then.
        seconds: length of the phase [s].
        speed: at its beginning, and at its end again [m/s].
        bank: of its turns [deg].
    """
    high: tuple[Segment, ...] = (
        Turn(angle=180.0, bank=bank),
        Climb(height_change=300.0, rate=8.0),
        SpeedChange(speed=1.2 * speed, acceleration=2.0),
        Turn(angle=-90.0, bank=bank),
        Straight(duration=10.0),
        Turn(angle=-180.0, bank=bank),
        Climb(height_change=-300.0, rate=8.0),
        SpeedChange(speed=speed, acceleration=2.0),
        Turn(angle=90.0, bank=bank),
        Straight(duration=10.0),
    )
    low: tuple[Segment, ...] = (
        Straight(duration=60.0),
        Turn(angle=30.0, bank=bank),
        Straight(duration=60.0),
        Climb(height_change=100.0, rate=3.0),
        Turn(angle=-30.0, bank=bank),
        SpeedChange(speed=1.05 * speed, acceleration=0.5),
        Straight(duration=40.0),
        Climb(height_change=-100.0, rate=3.0),
        SpeedChange(speed=speed, acceleration=0.5),
    )
    found: list[Segment] = []
    left, now = seconds, speed
    for segment in cycle(high if intensity == "high" else low):
        after = segment.speed if isinstance(segment, SpeedChange) else now
        # What is begun must leave time to come back to the speed of the beginning.
        rest = length(SpeedChange(speed=speed, acceleration=2.0), after) if after != speed else 0.0
        if length(segment, now) + rest > left:
            break
        found.append(segment)
        left -= length(segment, now)
        now = after
    if now != speed:
        back = SpeedChange(speed=speed, acceleration=2.0)
        found.append(back)
        left -= length(back, now)
    if left > 0.0:
        found.append(Straight(duration=left))
    return found


def length(segment: Segment, speed: float) -> float:
    """Seconds that a segment takes when it is entered at ``speed`` [m/s], up to the rounding to whole samples."""
    match segment:
        case Straight() | Hold():
            return segment.duration
        case Turn():
            rate = math.radians(segment.rate) if segment.rate is not None else _turn_rate(segment, speed)
            return abs(math.radians(segment.angle)) / rate + segment.entry
        case Climb():
            if segment.duration is not None:
                return segment.duration
            assert segment.rate is not None  # the model's validator
            return abs(segment.height_change) / segment.rate + segment.entry
        case SpeedChange():
            return abs(segment.speed - speed) / segment.acceleration + segment.entry


def hour(phases: Sequence[tuple[Intensity, float]], speed: float, high_bank: float, low_bank: float) -> list[Segment]:
    """All phases one after the other; ``phases`` are (intensity, seconds)."""
    banks = {"high": high_bank, "low": low_bank}
    return [s for intensity, seconds in phases for s in phase(intensity, seconds, speed, banks[intensity])]


def _turn_rate(turn: Turn, speed: float) -> float:
    assert turn.bank is not None  # the model's validator
    return earth.STANDARD_GRAVITY * math.tan(math.radians(turn.bank)) / speed
