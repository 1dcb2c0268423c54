"""Trajectories: what an aircraft, or a receiver at rest, truly does, and what a perfect IMU on it would measure.

A flight is a list of segments. Speed, vertical speed and heading are piecewise polynomials of time with two continuous
derivatives: every change enters and leaves through a quintic blend. What follows from them is evaluated where it is
asked for, by :mod:`ftcore.world.path`.

Conventions of :mod:`ftcore.earth`. A segment's fields carry the units of a scenario document (their JSON Schema says
which: seconds, metres, degrees); everything else here is SI and radians. Truth is common to all runs, so these arrays
lead with time, without a run axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator
from scipy.interpolate import PPoly

from ftcore import earth
from ftcore.world.path import Path, Trajectory

Array = NDArray[np.float64]

MAX_SAMPLES: Final = 4_000_000
"""Longest flight, in IMU samples (about 11 hours at 100 Hz)."""


def _field(unit: str, description: str, default: Any = ..., **limits: Any) -> Any:
    return Field(default, description=description, json_schema_extra={"unit": unit}, **limits)


def _entry(what: str) -> Any:
    return _field("s", f"time in which {what} builds up, and dies away", 3.0, ge=0.1, le=60.0)


class _Segment(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Straight(_Segment):
    """Straight and level at constant speed."""

    kind: Literal["straight"] = "straight"
    duration: float = _field("s", "how long", gt=0.0, le=36000.0)


class Hold(_Segment):
    """Stand still: a receiver at rest, an aircraft on the ground."""

    kind: Literal["hold"] = "hold"
    duration: float = _field("s", "how long", gt=0.0, le=36000.0)


class Climb(_Segment):
    """Change height (a descent is negative) at constant speed; give either the vertical speed or the duration."""

    kind: Literal["climb"] = "climb"
    height_change: float = _field("m", "up is positive", ge=-30000.0, le=30000.0)
    rate: float | None = _field("m/s", "steady vertical speed, unsigned", None, gt=0.0, le=1000.0)
    duration: float | None = _field("s", "how long in all", None, gt=0.0, le=36000.0)
    entry: float = _entry("the vertical speed")

    @model_validator(mode="after")
    def _one_of_rate_and_duration(self) -> Climb:
        if (self.rate is None) == (self.duration is None):
            raise ValueError("a climb takes either a rate or a duration")
        if self.duration is not None and self.duration < 2.0 * self.entry:
            raise ValueError(f"a climb of {self.duration} s has no room for two entries of {self.entry} s")
        return self


class Turn(_Segment):
    """Coordinated level turn through an angle; give either the bank or the turn rate."""

    kind: Literal["turn"] = "turn"
    angle: float = _field("deg", "change of heading, right (clockwise) is positive", ge=-36000.0, le=36000.0)
    bank: float | None = _field("deg", "steady bank, unsigned", None, gt=0.0, le=80.0)
    rate: float | None = _field("deg/s", "steady turn rate, unsigned", None, gt=0.0, le=60.0)
    entry: float = _entry("the turn rate")

    @model_validator(mode="after")
    def _one_of_bank_and_rate(self) -> Turn:
        if (self.bank is None) == (self.rate is None):
            raise ValueError("a turn takes either a bank or a rate")
        return self


class SpeedChange(_Segment):
    """Accelerate or brake, level and straight, to a new speed."""

    kind: Literal["speed"] = "speed"
    speed: float = _field("m/s", "speed afterwards", ge=0.0, le=3000.0)
    acceleration: float = _field("m/s^2", "steady acceleration, unsigned", 2.0, gt=0.0, le=100.0)
    entry: float = _entry("the acceleration")


Segment = Annotated[Straight | Hold | Climb | Turn | SpeedChange, Field(discriminator="kind")]
"""One piece of a flight; a scenario document embeds ``list[Segment]``."""

_ADAPTER: Final[TypeAdapter[Straight | Hold | Climb | Turn | SpeedChange]] = TypeAdapter(Segment)


def segment_from_dict(document: Mapping[str, Any]) -> Straight | Hold | Climb | Turn | SpeedChange:
    """A segment from its plain description, such as ``{"kind": "straight", "duration": 100}``.

    Raises:
        ValueError: unknown kind, missing or unknown field, value out of range; the message names the field.
    """
    try:
        return _ADAPTER.validate_python(dict(document))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"][1:]) or "segment"
        given = "" if first["type"] == "missing" else f" (given {first['input']!r})"
        raise ValueError(f"{where}: {first['msg']}{given}") from error


_Poly = Sequence[float]


class _Profile:
    """Vertical speed, acceleration and turn rate as piecewise polynomials of time, grown segment by segment.

    Each has degree five; coefficients are local to the piece, highest power first. Pieces are whole samples long: a
    joint inside a sample would spoil the quadrature there.
    """

    def __init__(self, speed: float, heading: float, dt: float) -> None:
        self.dt = dt
        self.breaks = [0]
        self.speed = self.start_speed = speed
        self.heading = self.start_heading = heading
        self.vertical: list[list[float]] = []
        self.acceleration: list[list[float]] = []
        self.turn_rate: list[list[float]] = []

    def add(self, samples: int, vertical: _Poly = (), acceleration: _Poly = (), turn_rate: _Poly = ()) -> None:
        if samples < 1:
            return
        self.breaks.append(self.breaks[-1] + samples)
        for pieces, poly in ((self.vertical, vertical), (self.acceleration, acceleration), (self.turn_rate, turn_rate)):
            pieces.append([0.0] * (6 - len(poly)) + list(poly))

    def steady(self, duration: float) -> None:
        """Go on as it is."""
        self.add(max(1, round(duration / self.dt)))

    def pulse(self, which: str, total: float, peak: float, entry: float) -> None:
        """Lay a smooth pulse of integral ``total`` on one slope: up to ``peak`` in ``entry`` s, steady, and down again.

        The total is met exactly: the peak gives way to the rounding, and where the total is too small for two entries.
        """
        if total == 0.0:
            return
        entry_samples = max(1, round(entry / self.dt))
        steady_samples = max(0, round(abs(total) / peak / self.dt) - entry_samples)
        entry = entry_samples * self.dt
        peak = total / (entry + steady_samples * self.dt)
        self.add(entry_samples, **{which: _blend(0.0, peak, entry)})
        self.add(steady_samples, **{which: (peak,)})
        self.add(entry_samples, **{which: _blend(peak, 0.0, entry)})

    def polynomials(self) -> tuple[PPoly, PPoly, PPoly]:
        """Vertical speed, speed, heading; the last piece is followed by one at rest in all slopes."""
        breaks = np.array([*self.breaks, self.breaks[-1] + 1]) * self.dt
        rest = [[0.0] * 6]
        vertical, acceleration, turn_rate = (
            PPoly(np.array(pieces + rest).T, breaks) for pieces in (self.vertical, self.acceleration, self.turn_rate)
        )
        speed, heading = acceleration.antiderivative(), turn_rate.antiderivative()
        speed.c[-1] += self.start_speed
        heading.c[-1] += self.start_heading
        return vertical, speed, heading


def _blend(start: float, end: float, duration: float) -> _Poly:
    """Quintic from ``start`` to ``end`` with zero first and second derivative at both ends."""
    d = end - start
    return (6.0 * d / duration**5, -15.0 * d / duration**4, 10.0 * d / duration**3, 0.0, 0.0, start)


def _lay(profile: _Profile, segment: Straight | Hold | Climb | Turn | SpeedChange) -> None:
    """Append one segment to the profile. Raises ValueError where the flight so far does not allow it."""
    speed = profile.speed
    if isinstance(segment, Hold):
        if speed > 0.0:
            raise ValueError(f"hold: cannot stand still at {speed:g} m/s; fly straight, or change speed to 0 first")
        profile.steady(segment.duration)
        return
    if isinstance(segment, SpeedChange):
        profile.pulse("acceleration", segment.speed - speed, segment.acceleration, segment.entry)
        profile.speed = segment.speed
        return
    if speed <= 0.0:
        raise ValueError(f"{segment.kind}: at rest; hold, or change speed first")
    if isinstance(segment, Straight):
        profile.steady(segment.duration)
    elif isinstance(segment, Climb):
        change = segment.height_change
        rate = abs(change) / (segment.duration - segment.entry) if segment.duration is not None else segment.rate
        assert rate is not None  # the model's validator
        if min(rate, abs(change) / segment.entry) > 0.9 * speed:
            raise ValueError(f"climb: a vertical speed of {rate:g} m/s needs more than the speed of {speed:g} m/s")
        if change == 0.0:
            profile.steady(segment.duration or 0.0)
        profile.pulse("vertical", change, rate, segment.entry)
    else:
        if segment.bank is not None:
            rate = earth.STANDARD_GRAVITY * math.tan(math.radians(segment.bank)) / speed
        else:
            assert segment.rate is not None  # the model's validator
            rate = math.radians(segment.rate)
        profile.pulse("turn_rate", math.radians(segment.angle), rate, segment.entry)


def plan(
    initial_lla: Sequence[float] | Array,
    initial_speed: float,
    initial_heading: float,
    segments: Sequence[Straight | Hold | Climb | Turn | SpeedChange],
    dt: float,
) -> Path:
    """The path of the segments one after the other, to be evaluated where it is asked for.

    ``initial_lla`` (3,) rad, rad, m; ``initial_speed`` m/s, level, along ``initial_heading`` rad; ``dt`` s. Every
    part of a segment (entry, steady part) is rounded to whole samples; what it is to reach (angle, height, speed) is
    reached exactly. Speed is along the path; a straight flight keeps its track, so that due east stays due east.

    Raises:
        ValueError: nothing to fly, a segment that the motion so far does not allow, more than :data:`MAX_SAMPLES`
            samples, or a flight within 1 degree of a pole, where local-level axes turn too fast.
    """
    if not dt > 0.0:
        raise ValueError(f"dt must be positive; got {dt} s")
    if initial_speed < 0.0:
        raise ValueError(f"initial speed must not be negative; got {initial_speed} m/s")
    profile = _Profile(float(initial_speed), float(initial_heading), dt)
    for number, segment in enumerate(segments):
        try:
            _lay(profile, segment)
        except ValueError as error:
            raise ValueError(f"segments[{number}]: {error}") from None
    count = profile.breaks[-1]
    if count < 1:
        raise ValueError("there is nothing to fly: the segments change nothing and take no time")
    if count > MAX_SAMPLES:
        raise ValueError(f"{count * dt:g} s at {dt:g} s are {count} samples; at most {MAX_SAMPLES} are built")
    return Path(profile.polynomials(), np.asarray(initial_lla, dtype=np.float64), count, dt)


def build(
    initial_lla: Sequence[float] | Array,
    initial_speed: float,
    initial_heading: float,
    segments: Sequence[Straight | Hold | Climb | Turn | SpeedChange],
    dt: float,
) -> Trajectory:
    """The whole flight at once: arguments and errors of :func:`plan`."""
    return plan(initial_lla, initial_speed, initial_heading, segments, dt).whole()
