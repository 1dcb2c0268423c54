"""What can be chosen for the GPS receiver: parameters at the start, settings in flight.

``source`` in a field's schema says whether Chey 2004 gives the number ("paper") or FTLab chose it where Chey 2004 is
silent.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from ftcore.systems.base import NOISE_FLOOR, Form
from ftcore.systems.forms import CONFIRM, WITHIN, Supervised, false_alarm_probability, hold_off, quantity

LONGEST_LOG = 108_000.0
"""Longest flight on a log [s]: thirty hours, the longest log that is read."""


class Receiver(Form):
    """Where the simulated receiver stands, and when."""

    latitude: float = quantity(37.5665, "deg", "latitude; Seoul", -85.0, 85.0, "paper")
    longitude: float = quantity(126.978, "deg", "longitude; Seoul", -180.0, 180.0, "paper")
    height: float = quantity(50.0, "m", "height above the ellipsoid", -400.0, 9000.0)
    constellation_time: float = quantity(
        1800.0, "s", "start after the almanac epoch; at 1800 s Seoul sees 8 satellites", 0.0, 1e6
    )
    pseudorange: float = quantity(10.0, "m", "pseudorange noise, 1-sigma, all satellites", 0.01, 1000.0, "paper")
    clock_phase: float = quantity(1000.0, "m", "clock phase at the start, 1-sigma", 0.0, 1e6)
    clock_frequency: float = quantity(10.0, "m/s", "clock frequency at the start, 1-sigma", 0.0, 1e4)


class Log(Form):
    """A real receiver's log in place of the simulated one: RINEX 2 or 3, GPS, L1 code."""

    observation: str = Field(min_length=1, max_length=400, description="observation file")
    navigation: str = Field(min_length=1, max_length=400, description="navigation file of the same day")
    antenna: tuple[float, float, float] | None = Field(
        default=None,
        description="true antenna position, Earth-fixed; the observation file's approximate position if absent",
        json_schema_extra={"unit": "m"},
    )
    floor: float = Field(
        default=NOISE_FLOOR[1],
        ge=NOISE_FLOOR[0],
        le=NOISE_FLOOR[2],
        title="Noise floor",
        description="pseudorange 1-sigma at every elevation; the event log says which would fit where this does not",
        json_schema_extra={"unit": "m", "source": "FTLab default"},
    )
    slant: float = quantity(
        0.5, "m", "pseudorange 1-sigma at the zenith that grows with 1 / sin(elevation)", 0.0, 100.0
    )


class Filter(Form):
    """The 8-state position-velocity-clock filter."""

    position_noise: float = quantity(1.0, "m^2/s^3", "random-walk velocity S_p", 0.0, 1e4, "paper")
    clock_phase_noise: float = quantity(0.036, "m^2/s", "clock white frequency noise S_f", 0.0, 100.0, "paper")
    clock_frequency_noise: float = quantity(0.141, "m^2/s^3", "clock random-walk frequency S_g", 0.0, 100.0, "paper")
    velocity: float = quantity(1.0, "m/s", "velocity at the start, 1-sigma, each axis", 0.001, 1000.0)
    clock_frequency: float = quantity(300.0, "m/s", "clock frequency at the start, 1-sigma; 1 ppm", 0.001, 1e4)


class Parameters(Form):
    """Fixed when the experiment starts."""

    mask: float = quantity(5.0, "deg", "elevation mask", 0.0, 60.0, "paper")
    receiver: Receiver = Receiver()
    filter: Filter = Filter()
    log: Log | None = Field(default=None, description="a receiver's log; the simulated receiver if absent")

    @model_validator(mode="after")
    def _all_of_it_is_heard(self) -> Parameters:
        if self.log is not None:
            for name in self.receiver.differing(tuple(Receiver.model_fields)):
                self.refuse(
                    ("receiver", name), f"{name} changes nothing here: a log is played; leave it or the log out"
                )
        return self

    @property
    def longest(self) -> float:
        """Longest flight [s]; a log holds no path."""
        return super().longest if self.log is None else LONGEST_LOG


class Settings(Supervised):
    """Can be changed in flight; a change takes effect with the next epoch."""

    combination: Literal["sequential", "or", "and"] = Field(
        default="sequential",
        title="Combination",
        description="sequential: snapshot first, innovation test on the survivors; or, and: both on all satellites",
    )
    false_alarm_probability: float = false_alarm_probability("paper")
    missed_detection_probability: float = Field(
        default=1e-3,
        ge=1e-9,
        le=0.5,
        title="Missed detection",
        description="what minimal detectable biases and protection levels allow for",
        json_schema_extra={"unit": "1"},
    )
    wrong_isolation_probability: float = Field(
        default=1e-3,
        ge=1e-12,
        le=1.0,
        title="Wrong isolation",
        description="how sure the culprit must be against every other satellite; 1 takes the least residual",
        json_schema_extra={"unit": "1"},
    )
    alert_limit: float = Field(
        default=120.0,
        gt=0.0,
        le=1e5,
        title="Alert limit",
        description="a larger protection level makes the position unavailable; 120 m allows one exclusion over Seoul",
        json_schema_extra={"unit": "m"},
    )
    protection: Literal["slope", "separation"] = Field(
        default="slope", title="Protection level", description="how the protection level is found"
    )
    confirm: int = CONFIRM
    within: int = WITHIN
    hold_off: int = hold_off(
        3, "epochs in a row that an excluded satellite must agree with the others before it comes back"
    )
    reset_after: int = Field(
        default=2,
        ge=1,
        le=600,
        title="Reset after",
        description="epochs in a row of disagreement after which the combined filter restarts from its snapshot",
    )
    patience: int = Field(
        default=10,
        ge=1,
        le=600,
        title="Patience",
        description="epochs in a row that a filter takes nothing, as no culprit is found, before it restarts from all",
    )
