"""What can be chosen for the SINS/GPS/Doppler system: parameters at the start, settings in flight.

``source`` in a field's schema says whether Zhang 1992 gives the number ("paper") or FTLab chose it where Zhang 1992 is
silent.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from ftcore.detection import cusum
from ftcore.systems.base import Form
from ftcore.systems.forms import CONFIRM, WITHIN, Supervised, false_alarm_probability, hold_off, mounting, quantity
from ftcore.world.trajectory import Segment, Straight

DRIVERS = ("residual", "state", "two-propagator", "glr", "cusum")
Driver = Literal["residual", "state", "two-propagator", "glr", "cusum", "none"]

EPOCH = 1.0
"""Seconds between epochs."""


class Flight(Form):
    """Where it starts and how it flies."""

    latitude: float = quantity(40.0, "deg", "start latitude", -85.0, 85.0)
    longitude: float = quantity(116.0, "deg", "start longitude", -180.0, 180.0)
    height: float = quantity(5000.0, "m", "start height", -400.0, 20000.0)
    speed: float = quantity(300.0, "m/s", "start speed", 0.0, 1000.0, "paper")
    heading: float = quantity(90.0, "deg", "start heading, clockwise from north", -360.0, 360.0, "paper")
    segments: tuple[Segment, ...] = Field(
        default=(Straight(duration=10.0),),
        max_length=200,
        description="what is flown one after the other; level flight at the last speed afterwards",
    )


class Inertial(Form):
    """Redundant IMU: three 2-DOF gyros and three 2-DOF accelerometers."""

    rate: float = quantity(40.0, "Hz", "samples a second", 10.0, 200.0, "paper")
    mounting: tuple[float, float, float] = mounting()
    gyro_bias: float = quantity(0.1, "deg/h", "gyro drift, 1-sigma, each axis", 0.0, 1000.0)
    angle_random_walk: float = quantity(0.01, "deg/sqrt(h)", "gyro white noise, each axis", 0.0, 100.0)
    accelerometer_bias: float = quantity(100.0, "ug", "accelerometer bias, 1-sigma, each axis", 0.0, 1e6)
    accelerometer_noise: float = quantity(10.0, "ug/sqrt(Hz)", "accelerometer white noise, each axis", 0.0, 1e6)
    calibration: float = quantity(
        60.0, "s", "standstill before the flight that calibrates the parity vector", 1.0, 3600.0
    )


class Aiding(Form):
    """GPS, Doppler radar and altimeter."""

    constellation_time: float = quantity(48000.0, "s", "start of the flight after the almanac epoch", 0.0, 1e6)
    mask: float = quantity(5.0, "deg", "elevation mask", 0.0, 60.0)
    pseudorange: float = quantity(10.0, "m", "pseudorange noise, 1-sigma", 0.01, 1000.0)
    delta_range: float = quantity(0.1, "m/s", "delta pseudorange noise, 1-sigma", 0.001, 100.0)
    clock_phase_noise: float = quantity(0.036, "m^2/s", "clock white frequency noise S_f", 0.0, 100.0)
    clock_frequency_noise: float = quantity(0.141, "m^2/s^3", "clock random-walk frequency noise S_g", 0.0, 100.0)
    doppler: float = quantity(0.2, "m/s", "Doppler noise, 1-sigma, each axis", 0.001, 100.0)
    doppler_scale: float = quantity(0.002, "1", "Doppler scale-factor error d_k, 1-sigma", 0.0, 0.5)
    doppler_drift: float = quantity(0.002, "rad", "Doppler drift angle d_Delta, 1-sigma", 0.0, 0.5)
    altimeter_noise: float = quantity(1.0, "m", "altimeter white noise, 1-sigma", 0.0, 1000.0)
    altimeter_bias: float = quantity(30.0, "m", "altimeter bias E_po, 1-sigma", 0.0, 10000.0)
    altimeter_scale: float = quantity(0.01, "1", "altimeter scale-factor error E_hsf, 1-sigma", 0.0, 0.5)
    vertical_damping: float = quantity(30.0, "s", "time constant of the damped vertical channel", 5.0, 1000.0)


class Initial(Form):
    """Errors of the alignment, 1-sigma."""

    position: float = quantity(50.0, "m", "each axis", 0.01, 10000.0)
    velocity: float = quantity(1.0, "m/s", "each axis", 0.001, 100.0)
    tilt: float = quantity(1e-4, "rad", "each axis", 1e-7, 0.02)
    azimuth: float = quantity(1e-3, "rad", "azimuth", 1e-7, 0.05)
    clock_phase: float = quantity(1000.0, "m", "receiver clock phase", 0.01, 1e6)
    clock_frequency: float = quantity(10.0, "m/s", "receiver clock frequency", 0.001, 1e4)


class Parameters(Form):
    """Fixed when the flight starts."""

    flight: Flight = Flight()
    inertial: Inertial = Inertial()
    aiding: Aiding = Aiding()
    initial: Initial = Initial()


class Settings(Supervised):
    """Can be changed in flight; a change takes effect with the next epoch."""

    driving_test: Driver = Field(
        default="residual",
        title="Driven by",
        description="the test whose alarms exclude GPS or Doppler; the others watch. none: nobody is excluded",
    )
    false_alarm_probability: float = false_alarm_probability(most=cusum.MOST_P_FA)
    confirm: int = CONFIRM
    within: int = WITHIN
    hold_off: int = hold_off(5, "epochs in a row that must pass the admission test before re-admission")
    imu_driving_test: Literal["glt", "parity", "none"] = Field(
        default="glt", title="IMU driven by", description="the test that isolates an instrument of the redundant IMU"
    )
    altimeter_driving_test: Literal["innovation", "none"] = Field(
        default="innovation",
        title="Altimeter driven by",
        description="the test that isolates the altimeter: its innovation before it damps the strapdown. none: its "
        "height is taken whatever it says, as in Zhang 1992",
    )
    fusion_mode: Literal["fusion-reset", "no-reset", "zero-reset", "rescale"] = Field(
        default="fusion-reset",
        title="Fusion mode",
        description="what the master gives back to the local filters; no-reset is the paper's",
    )
    master: Literal["federated", "covariance-intersection", "tolerant"] = Field(
        default="federated",
        title="Master",
        description="federated: local filters, merged (Zhang 1992); covariance intersection: the filters that are "
        "alone, their correlation taken as unknown; tolerant: every subset of the aids, weighed by the driving test's "
        "q (Yang 2016)",
    )
    doubt_probability: float = Field(
        default=0.1,
        ge=1e-9,
        le=0.9,
        title="Doubt",
        description="tolerant master: an aid counts fully up to this quantile of q, less beyond, not at all at alarm",
        json_schema_extra={"unit": "1"},
    )
    gps_share: float = Field(
        default=0.5,
        ge=0.001,
        le=0.999,
        title="GPS share",
        description="1/r of the SINS/GPS filter; the Doppler filter has the rest (28)",
        json_schema_extra={"unit": "1"},
    )
    satellite_integrity: Literal["off", "snapshot", "innovation"] = Field(
        default="off",
        title="Satellite integrity",
        description="a wrong satellite is left out before the GPS measurement is used: satellites against each other "
        "(snapshot), or against the strapdown too (innovation). off is the paper's",
    )
    wrong_isolation_probability: float = Field(
        default=1e-3,
        ge=1e-12,
        le=1.0,
        title="Wrong isolation",
        description="how sure satellite integrity must be of the culprit against every other satellite",
        json_schema_extra={"unit": "1"},
    )
    propagator_period: int = Field(
        default=30,
        ge=2,
        le=600,
        title="Propagator period",
        description="seconds between resets of the two propagators; longer while anybody is suspected",
        json_schema_extra={"unit": "s"},
    )

    @model_validator(mode="after")
    def _doubt_comes_first(self) -> Settings:
        if self.master == "tolerant" and self.doubt_probability <= self.false_alarm_probability:
            raise ValueError(
                f"doubt begins before rejection: its probability {self.doubt_probability:g} must be larger than the "
                f"false-alarm probability {self.false_alarm_probability:g}"
            )
        return self

    def without_effect(self, parameters: Any, settled: bool = True) -> Mapping[str, str]:
        """See :meth:`ftcore.systems.base.Form.without_effect`."""
        idle: dict[str, str] = {}
        if self.master != "tolerant":
            idle["doubt_probability"] = "no aid counts in part; setting master = 'tolerant' weighs them by doubt"
        if self.satellite_integrity == "off":
            idle["wrong_isolation_probability"] = (
                "no satellite is ever left out; setting satellite_integrity = 'snapshot' or 'innovation' leaves out"
            )
        return idle
