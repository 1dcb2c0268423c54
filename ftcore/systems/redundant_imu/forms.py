"""What can be chosen for the redundant-IMU system: parameters at the start, settings in flight.

``source`` in a field's schema says whether Kim 2005 gives the number ("paper") or FTLab chose it where Kim 2005 is
silent.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from ftcore.systems.base import Form
from ftcore.systems.forms import CONFIRM, WITHIN, Supervised, false_alarm_probability, hold_off, mounting, quantity
from ftcore.systems.redundant_imu.flight import trims
from ftcore.world.aircraft import Aircraft, f16

MOST_LEAD = 20
"""Longest way back that the UKF may be started [epochs]."""

Driver = Literal["isolation-angle", "fault-plane", "glt", "optimal-parity", "none"]


class Leg(Form):
    """One part of the mission."""

    duration: float = quantity(5.0, "s", "how long", 0.1, 1000.0)
    climb_rate: float = quantity(0.0, "ft/s", "climb rate", -60.0, 200.0)
    bank: float = quantity(0.0, "deg", "bank angle, right wing down", -70.0, 70.0)


class Flight(Form):
    """What is flown; the last leg goes on to the end."""

    speed: float = quantity(502.0, "ft/s", "airspeed", 350.0, 800.0)
    height: float = quantity(1000.0, "m", "start height", 100.0, 10000.0)
    heading: float = quantity(0.0, "deg", "start heading, clockwise from north", -360.0, 360.0)
    legs: tuple[Leg, ...] = Field(
        default=(Leg(duration=5.0, climb_rate=120.0), Leg(duration=10.0, bank=45.0)),
        min_length=1,
        max_length=50,
        description="climb at 120 ft/s for 5 s, then a bank turn for 10 s",
        json_schema_extra={"source": "paper; bank angle and climb rate of the turn: FTLab default"},
    )


class Gyros(Form):
    """Three gyros of two axes each."""

    mounting: tuple[float, float, float] = mounting()
    noise: float = quantity(0.01, "rad/s", "white noise of each axis, 1-sigma a sample", 1e-6, 1.0, "paper")


class AirData(Form):
    """Airspeed, angles of attack and sideslip, and height, 1-sigma a sample."""

    speed: float = quantity(0.5, "m/s", "airspeed", 0.01, 50.0)
    angle: float = quantity(0.2, "deg", "angle of attack and sideslip", 0.001, 10.0)
    height: float = quantity(1.0, "m", "height", 0.01, 100.0)


class Mismatch(Form):
    """How the aircraft that flies differs from the one that UKF and flight control believe in. All zero: ideal."""

    mass: float = quantity(3.0, "%", "heavier by, inertia with it", -30.0, 100.0)
    centre_of_gravity: float = quantity(3.0, "%", "centre of gravity further aft by, of the mean chord", -20.0, 20.0)
    aerodynamics: float = quantity(3.0, "%", "aerodynamic forces larger and moments smaller by", -50.0, 50.0)


class Trust(Form):
    """Accelerations that the UKF allows its model to be wrong by, 1-sigma a step; they make its process noise."""

    speed: float = quantity(1.0, "m/s^2", "along the flight path", 0.001, 100.0)
    wind: float = quantity(0.05, "rad/s", "rate of the angles of attack and sideslip", 1e-5, 10.0)
    attitude: float = quantity(0.003, "rad/s", "rate of roll and pitch", 1e-5, 10.0)
    rate: float = quantity(0.4, "rad/s^2", "angular acceleration", 1e-4, 100.0)
    height: float = quantity(1.0, "m/s", "vertical speed", 1e-3, 100.0)


class Parameters(Form):
    """Fixed when the flight starts."""

    plant: Literal["stevens-lewis", "jsbsim"] = Field(
        default="stevens-lewis",
        title="Aircraft that flies",
        description="stevens-lewis: the published F-16, on stability augmentation by LQR; jsbsim: JSBSim's F-16 under "
        "its own control laws, each run by itself (needs the package jsbsim, ftlab[jsbsim]). The UKF believes in the "
        "published one",
        json_schema_extra={"source": "FTLab default"},
    )
    flight: Flight = Flight()
    gyros: Gyros = Gyros()
    air_data: AirData = AirData()
    mismatch: Mismatch = Mismatch()
    trust: Trust = Trust()

    @model_validator(mode="after")
    def _can_be_flown(self) -> Parameters:
        for whose, aircraft in (("as published", f16()), ("with this mismatch", self.flown())):
            for k, leg in enumerate(self.flight.legs):
                try:
                    trims(aircraft, self.flight, (leg,))
                except ValueError as error:
                    self.refuse(("flight", "legs", k), f"the aircraft {whose} cannot fly this: {error}")
        if self.plant == "jsbsim":
            if self.mismatch != Mismatch():
                why = "JSBSim's aircraft is as it is; with plant jsbsim leave mismatch out"
                self.refuse(("mismatch",), f"mismatch changes nothing here: {why}")
            if self.flight.legs[0].bank != 0.0:
                self.refuse(("flight", "legs", 0, "bank"), "JSBSim begins with wings level: the first leg's bank is 0")
        return self

    def flown(self) -> Aircraft:
        """The aircraft that flies."""
        m = self.mismatch
        return f16().differing(0.01 * m.mass, 0.01 * m.centre_of_gravity, 0.01 * m.aerodynamics)


class Settings(Supervised):
    """Can be changed in flight; a change takes effect with the next epoch."""

    driving_test: Driver = Field(
        default="isolation-angle",
        title="Driven by",
        description="the test that declares gyros; the others watch. none: nobody is isolated",
    )
    false_alarm_probability: float = false_alarm_probability()
    angle_threshold: float = Field(
        default=15.0,
        ge=1.0,
        le=44.0,
        title="Angle threshold",
        description="T_i: a gyro whose fault plane is nearer to the parity vector is declared",
        json_schema_extra={"unit": "deg", "source": "FTLab default"},
    )
    hybrid: bool = Field(
        default=True,
        title="Hybrid",
        description="where several gyros are declared the UKF decides; off: it is said that nobody can be isolated, "
        "and the readings that fit together best are flown on",
    )
    lead: int = Field(
        default=3,
        ge=1,
        le=MOST_LEAD,
        title="UKF lead",
        description="steps before the alarm at which the UKF starts, from states that the fault has not reached",
        json_schema_extra={"unit": "epochs", "source": "paper"},
    )
    confirm: int = CONFIRM
    within: int = WITHIN
    hold_off: int = hold_off(
        25, "epochs in a row in which an isolated gyro must agree with the others before it is trusted again"
    )

    def without_effect(self, parameters: Any, settled: bool = True) -> Mapping[str, str]:
        """See :meth:`ftcore.systems.base.Form.without_effect`."""
        idle: dict[str, str] = {}
        if not self.hybrid:
            idle["lead"] = "the UKF never starts; setting hybrid = true lets it"
        if self.driving_test == "none" and settled:
            why = "nobody is declared faulty; setting driving_test to one of the tests changes that"
            idle |= dict.fromkeys(("confirm", "within", "hold_off"), why)
        return idle
