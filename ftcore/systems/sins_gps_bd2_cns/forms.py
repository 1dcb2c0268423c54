"""What can be chosen for the SINS/GPS/BD2/CNS system: parameters at the start, settings in flight.

``source`` in a field's schema says whether Yang 2016 gives the number ("paper") or FTLab chose it where Yang 2016 is
silent.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from ftcore.systems.base import Form
from ftcore.systems.forms import CONFIRM, WITHIN, Supervised, hold_off, mounting, quantity
from ftcore.world.manoeuvres import Intensity
from ftcore.world.trajectory import Segment

PAPER = "paper"
ALONE = "three axes do not check each other; parameter inertial.configuration = 'redundant' brings an IMU that does"

EPOCH = 1.0
"""Seconds between epochs."""


class Phase(Form):
    """A part of the flight under high or low manoeuvre."""

    intensity: Intensity = Field(description="how the aircraft flies")
    duration: float = quantity(600.0, "s", "how long", 1.0, 36000.0)


class Flight(Form):
    """Where it starts and how it flies."""

    latitude: float = quantity(32.0, "deg", "start latitude", -85.0, 85.0)
    longitude: float = quantity(118.8, "deg", "start longitude", -180.0, 180.0)
    height: float = quantity(8000.0, "m", "start height", -400.0, 20000.0)
    speed: float = quantity(150.0, "m/s", "start speed", 1.0, 1000.0)
    heading: float = quantity(45.0, "deg", "start heading, clockwise from north", -360.0, 360.0)
    phases: tuple[Phase, ...] = Field(
        default=(
            Phase(intensity="high", duration=600.0),
            Phase(intensity="low", duration=600.0),
            Phase(intensity="high", duration=1800.0),
            Phase(intensity="low", duration=600.0),
        ),
        max_length=50,
        description="phases of high and low manoeuvre, Yang 2016 section 4; level flight afterwards",
        json_schema_extra={"source": PAPER},
    )
    high_bank: float = quantity(30.0, "deg", "bank of the turns under high manoeuvre", 1.0, 70.0)
    low_bank: float = quantity(5.0, "deg", "bank of the turns under low manoeuvre", 1.0, 70.0)
    segments: tuple[Segment, ...] = Field(
        default=(), max_length=200, description="what is flown instead of the phases, one after the other"
    )

    @model_validator(mode="after")
    def _all_of_it_is_flown(self) -> Flight:
        banks = {"high": "high_bank", "low": "low_bank"}
        if self.segments:
            for name in self.differing(("phases", *banks.values())):
                self.refuse((name,), f"{name} changes nothing here: segments are flown instead; leave one of them out")
        flown = {phase.intensity for phase in self.phases}
        for intensity, name in banks.items():
            if intensity not in flown and self.differing((name,)):
                self.refuse((name,), f"{name} changes nothing here: no phase has intensity {intensity!r}; add one")
        return self


class Inertial(Form):
    """Strapdown IMU: three gyros and three accelerometers along the body axes, or the redundant IMU of Kim 2005."""

    configuration: Literal["three-axis", "redundant"] = Field(
        default="three-axis",
        description="redundant: three 2-DOF gyros and three 2-DOF accelerometers with their own fault detection",
        json_schema_extra={"source": PAPER},
    )
    rate: float = quantity(100.0, "Hz", "samples a second, 1 / T_SINS", 10.0, 200.0, PAPER)
    gyro_bias: float = quantity(1.0, "deg/h", "gyro bias, 1-sigma, each axis", 0.0, 1000.0, PAPER)
    angle_random_walk: float = quantity(0.01, "deg/sqrt(h)", "gyro white noise, each axis", 0.0, 100.0, PAPER)
    accelerometer_bias: float = quantity(60.0, "ug", "accelerometer bias, 1-sigma, each axis", 0.0, 1e6, PAPER)
    accelerometer_noise: float = quantity(10.0, "ug/sqrt(Hz)", "accelerometer white noise, each axis", 0.0, 1e6, PAPER)
    scale_factor: float = quantity(
        300.0, "ppm", "scale-factor error that no filter models, 1-sigma, each axis", 0.0, 1e5
    )
    mounting: tuple[float, float, float] = mounting()
    calibration: float = quantity(
        60.0, "s", "standstill before the flight that calibrates the redundant IMU's parity vector", 1.0, 3600.0
    )

    @model_validator(mode="after")
    def _all_of_it_is_fitted(self) -> Inertial:
        if self.configuration == "three-axis":
            for name in self.differing(("mounting", "calibration")):
                self.refuse((name,), f"{name} changes nothing here: {ALONE}")
        return self


class Aiding(Form):
    """GPS and BD2 positions, and the attitude of the star tracker (CNS): Table 2. Three numbers: east, north, up."""

    gps: tuple[float, float, float] = Field(
        default=(2.92, 3.06, 2.98),
        title="GPS",
        description="GPS position noise, 1-sigma",
        json_schema_extra={"unit": "m", "source": PAPER},
    )
    bd2: tuple[float, float, float] = Field(
        default=(2.50, 2.75, 2.78),
        title="BD2",
        description="BD2 position noise, 1-sigma",
        json_schema_extra={"unit": "m", "source": PAPER},
    )
    cns: float = quantity(3.0, "arcsec", "CNS attitude noise, 1-sigma, each angle", 0.01, 36000.0, PAPER)
    constellation_time: float = quantity(48000.0, "s", "start of the flight after the almanac epoch", 0.0, 1e6)
    mask: float = quantity(5.0, "deg", "elevation mask of what the scene shows", 0.0, 60.0)


class Initial(Form):
    """Errors of the alignment, 1-sigma: Table 3."""

    position: float = quantity(5.0, "m", "each axis", 0.01, 10000.0)
    velocity: float = quantity(0.02, "m/s", "each axis", 0.001, 100.0, PAPER)
    tilt: float = quantity(1e-4, "rad", "each axis", 1e-7, 0.02, PAPER)
    azimuth: float = quantity(1e-3, "rad", "azimuth", 1e-7, 0.05, PAPER)


class Models(Form):
    """The models that the filters believe in."""

    noise_scale: float = quantity(
        1.0, "1", "Q_small in units of the variance that Table 1's white noise adds", 0.01, 1e6
    )
    ratio: float = quantity(100.0, "1", "Q_large over Q_small", 1.0, 1e8, PAPER)
    stay: float = quantity(
        0.98, "1", "probability that a model stays in effect from one second to the next", 0.5, 0.9999, PAPER
    )
    start_large: float = quantity(0.1, "1", "probability of Q_large at the start", 0.0, 1.0, PAPER)
    accelerometer_start: float = quantity(
        300.0,
        "ug",
        "accelerometer bias that P(0) allows for, 1-sigma: 1 g times 300 ppm looks like 300 ug of bias; "
        "Table 1's 60 ug alone rejects both satellite systems in the first minutes of some flights",
        0.01,
        1e6,
    )
    bias_instability: float = quantity(
        1.0, "1", "part of Table 1's biases that wanders in flight: 1-sigma of the Gauss-Markov process", 0.0, 10.0
    )
    bias_time: float = quantity(3600.0, "s", "time constant tau of the biases' Gauss-Markov process", 10.0, 1e7)


class Parameters(Form):
    """Fixed when the flight starts."""

    flight: Flight = Flight()
    inertial: Inertial = Inertial()
    aiding: Aiding = Aiding()
    initial: Initial = Initial()
    models: Models = Models()


class Settings(Supervised):
    """Can be changed in flight; a change takes effect with the next epoch."""

    driving_test: Literal["two-propagator", "two-propagator-state", "none"] = Field(
        default="two-propagator",
        title="Form of q",
        description="whose q weighs the aids: the innovation form is chi-square 3 for a matched model; the "
        "state form compares the filter's estimate with the propagator's and is slower. none: everybody is trusted",
    )
    false_alarm_probability: float = Field(
        default=0.01,
        ge=1e-9,
        le=0.2,
        title="False alarm",
        description="per test and epoch: q above this quantile has weight 0; 1 % is the paper's 11.35",
        json_schema_extra={"unit": "1", "source": PAPER},
    )
    doubt_probability: float = Field(
        default=0.10,
        ge=1e-9,
        le=0.9,
        title="Doubt",
        description="q below this quantile has weight 1; 10 % is the paper's 6.25",
        json_schema_extra={"unit": "1", "source": PAPER},
    )
    mode_driver: Literal["smallest", "accepted", "held"] = Field(
        default="smallest",
        title="Model probabilities by",
        description="smallest: the aid with the smallest q updates them, rejected or not (Yang 2016); accepted: only "
        "one that is not rejected, else the transition matrix alone; held: the same, but they stay while all are "
        "rejected",
    )
    exclusion: Literal["weights", "isolation"] = Field(
        default="weights",
        title="Exclusion",
        description="weights: q of each second alone weighs an aid (Yang 2016), so a faulty one slips in now and then; "
        "isolation: one that the supervisor has isolated has no weight until it is readmitted, and a star tracker that "
        "jumped away is not before it has jumped back, or for two and a half minutes",
    )
    confirm: int = Field(default=3, ge=1, le=20, title="Confirm, m", description=CONFIRM.description)
    within: int = Field(default=4, ge=1, le=20, title="of n epochs", description=WITHIN.description)
    hold_off: int = hold_off(5, "epochs in a row without an alarm before re-admission")
    recovery: Literal["fused", "both", "none"] = Field(
        default="fused",
        title="Recovery",
        description="GPS and BD2 are believed again when both are rejected but agree with each other, CNS when it "
        "moves as the data sheet of the gyros allows and did not jump away: then the reference is wrong. Yang 2016 has "
        "no way out of a wrong reference; fused: only the filter with IMM has one, both: the one without IMM too",
    )
    propagator_models: Literal["filter", "own"] = Field(
        default="filter",
        title="Propagator noise",
        description="by whose model probabilities: filter, the fusion filter's of the moment; own, those it had at the "
        "reset, which the transition matrix alone then takes to one half, and small faults hide in 50 Q_small",
    )
    propagator_period: int = Field(
        default=30,
        ge=2,
        le=600,
        title="Propagator period",
        description="seconds between resets of the two propagators",
        json_schema_extra={"unit": "s", "source": PAPER},
    )
    feedback_period: int = Field(
        default=60,
        ge=1,
        le=3600,
        title="Feedback T_4",
        description="seconds between corrections of the strapdown by the fused estimate",
        json_schema_extra={"unit": "s", "source": PAPER},
    )
    master: Literal["tolerant", "federated"] = Field(
        default="tolerant",
        title="Master",
        description="tolerant: the eight subsets of aids, weighed by q (Yang 2016); federated: local filters of which "
        "the supervisor's isolated ones are left out (Zhang 1992)",
    )
    fusion_mode: Literal["fusion-reset", "no-reset", "zero-reset", "rescale"] = Field(
        default="fusion-reset",
        title="Federated mode",
        description="what the federated master gives back to its local filters",
    )
    imu_driving_test: Literal["glt", "parity", "none"] = Field(
        default="glt", title="IMU driven by", description="the test that isolates an instrument of the redundant IMU"
    )

    @model_validator(mode="after")
    def _doubt_comes_first(self) -> Settings:
        if self.driving_test != "none" and self.doubt_probability <= self.false_alarm_probability:
            raise ValueError(
                f"doubt begins before rejection: its probability {self.doubt_probability:g} must be larger than the "
                f"false-alarm probability {self.false_alarm_probability:g}"
            )
        return self

    def without_effect(self, parameters: Any, settled: bool = True) -> Mapping[str, str]:
        """See :meth:`ftcore.systems.base.Form.without_effect`."""
        p: Parameters = parameters
        idle: dict[str, str] = {}
        plain = p.inertial.configuration == "three-axis"
        if plain:
            idle["imu_driving_test"] = ALONE
        if self.master == "tolerant":
            idle["fusion_mode"] = "there are no local filters to give back to; setting master = 'federated' has them"
        else:
            idle["exclusion"] = "the federated master always leaves out who is isolated; setting master = 'tolerant'"
        if self.driving_test == "none":
            why = "everybody is trusted; setting driving_test to one of the tests changes that"
            idle |= dict.fromkeys(("doubt_probability", "recovery"), why)
            if settled:
                idle["exclusion"] = why
                if plain or self.imu_driving_test == "none":
                    idle |= dict.fromkeys(("confirm", "within", "hold_off"), why)
        return idle
