"""World and sensors of the SINS/GPS/Doppler system: the only part that knows truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftcore import earth, units
from ftcore.estimation.strapdown import InsState
from ftcore.noise import NoiseSource
from ftcore.parts.navigation import Truth
from ftcore.readings import Readings
from ftcore.rotation import rotvec_to_matrix, rpy_to_matrix
from ftcore.sensors import altimeter, doppler, gnss
from ftcore.sensors.inertial import AxisCluster
from ftcore.systems.sins_gps_doppler.aids import SLOTS
from ftcore.systems.sins_gps_doppler.forms import EPOCH, Flight, Parameters
from ftcore.world import constellation
from ftcore.world.path import Path
from ftcore.world.trajectory import Straight, plan

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlantState:
    """What the plant carries from epoch to epoch."""

    clock: gnss.Clock


class Plant:
    """See :class:`ftcore.systems.base.Plant`. All runs fly the same path, each with its own sensors."""

    def __init__(self, p: Parameters, axes: Array, duration: float, noise: NoiseSource) -> None:
        self._p = p
        self._noise = noise
        self.samples = max(1, round(p.inertial.rate * EPOCH))
        self.dt = EPOCH / self.samples
        self.path = fly(p.flight, duration, self.dt)
        self._times: Array = (np.arange(self.samples, dtype=np.float64) + 0.5) * self.dt
        i, a = p.inertial, p.aiding
        self.gyro = AxisCluster.drawn(
            "imu.gyro",
            axes,
            units.to_si(i.gyro_bias, "deg/h"),
            units.to_si(i.angle_random_walk, "deg/sqrt(h)"),
            noise,
        )
        self.accelerometer = AxisCluster.drawn(
            "imu.accelerometer",
            axes,
            units.to_si(i.accelerometer_bias, "ug"),
            units.to_si(i.accelerometer_noise, "ug/sqrt(Hz)"),
            noise,
        )
        draw = noise.normal
        self._doppler_scale = a.doppler_scale * draw("doppler.scale", 0)
        self._doppler_drift = a.doppler_drift * draw("doppler.drift", 0)
        self._altimeter_bias = a.altimeter_bias * draw("altimeter.bias", 0)
        self._altimeter_scale = a.altimeter_scale * draw("altimeter.scale", 0)
        self._clock = gnss.Clock(
            p.initial.clock_phase * draw("gps.clock.phase", 0),
            p.initial.clock_frequency * draw("gps.clock.frequency", 0),
        )

    def initial(self) -> PlantState:
        """Before the first epoch."""
        return PlantState(self._clock)

    def step(self, state: PlantState, epoch: int, command: object) -> tuple[PlantState, Truth, Readings]:
        """One epoch: where the aircraft is at its end, and what the sensors say."""
        p, t = self._p.aiding, self.path.between((epoch - 1) * self.samples, epoch * self.samples)
        now = epoch * EPOCH
        truth = Truth(t.lla[-1:], t.v_n[-1:], rpy_to_matrix(t.rpy[-1:]), t.rpy[-1:])
        times = np.add(now - EPOCH, self._times)
        clock = state.clock.step(EPOCH, p.clock_phase_noise, p.clock_frequency_noise, self._noise, epoch)
        position, velocity = constellation.satellite_states(p.constellation_time + now)
        sight = constellation.line_of_sight(truth.lla[0], position)
        C_en = earth.enu_to_ecef_matrix(truth.lla[0, 0], truth.lla[0, 1])
        range_rate = np.vecdot(sight.unit_n, velocity @ C_en - truth.v_n)
        ranges, rates = gnss.sense(
            sight.range[None],
            range_rate[None],
            sight.visible(p.mask)[None],
            clock,
            p.pseudorange,
            p.delta_range,
            self._noise,
            epoch,
            now,
        )
        groups = {
            "imu.gyro": self.gyro.sense(t.omega_b[None], epoch, times, self.dt),
            "imu.accelerometer": self.accelerometer.sense(t.f_b[None], epoch, times, self.dt),
            "gps.pseudorange": ranges,
            "gps.delta_range": rates,
            "doppler.velocity": doppler.sense(
                truth.v_n, truth.C_nb, self._doppler_scale, self._doppler_drift, p.doppler, self._noise, epoch, now
            ),
            "altimeter.height": altimeter.sense(
                truth.lla[:, 2], self._altimeter_bias, self._altimeter_scale, p.altimeter_noise, self._noise, epoch, now
            ),
        }
        aiding = {"satellites": position, "velocities": velocity}
        return PlantState(clock), truth, Readings(now, groups, aiding)

    def visible(self, channel: str, start: float, end: float) -> bool:
        """See :attr:`ftcore.systems.base.Assembly.visible`."""
        sensor, _, part = channel.split(".")
        if sensor != "gps" or part not in SLOTS:
            return True
        times = np.linspace(start, end, 2 + int((end - start) / constellation.LOOKS))
        f = self._p.flight
        lla = np.array([math.radians(f.latitude), math.radians(f.longitude), f.height])
        fastest = max([f.speed, *(getattr(segment, "speed", 0.0) or 0.0 for segment in f.segments)])
        p = self._p.aiding
        since = p.constellation_time + times
        return constellation.may_be_visible(SLOTS.index(part), lla, since, p.mask, fastest * times)

    def alignment(self) -> InsState:
        """What the navigator is told at the start: the truth with the alignment's errors, ``(runs, ...)``."""
        initial, t, draw = self._p.initial, self.path.between(0, 1), self._noise.normal
        meridian, normal = earth.principal_radii(t.lla[0, 0])
        metres = initial.position * draw("initial.position", 0, (3,))
        scale = np.array([normal + t.lla[0, 2], meridian + t.lla[0, 2], 1.0])
        east, north, up = np.moveaxis(metres / scale, -1, 0)
        lla = t.lla[0] + np.stack([north, east / math.cos(t.lla[0, 0]), up], axis=-1)
        v_n = t.v_n[0] + initial.velocity * draw("initial.velocity", 0, (3,))
        tilt = np.array([initial.tilt, initial.tilt, initial.azimuth]) * draw("initial.attitude", 0, (3,))
        return InsState(lla, v_n, rotvec_to_matrix(tilt) @ rpy_to_matrix(t.rpy[:1])[0])

    def calibration(self) -> tuple[Array, Array]:
        """Mean readings of all axes over a standstill before the flight, gyros and accelerometers, ``(runs, k)``."""
        seconds = self._p.inertial.calibration
        at_rest = np.zeros(3)
        return self.gyro.calibrate(at_rest, seconds), self.accelerometer.calibrate(at_rest, seconds)


@lru_cache(maxsize=8)
def fly(f: Flight, duration: float, dt: float) -> Path:
    """The path of a flight, as long as the scenario: level flight follows the last segment. Kept for branches."""
    lla = np.array([math.radians(f.latitude), math.radians(f.longitude), f.height])
    heading = math.radians(f.heading)
    needed = math.ceil(duration / EPOCH) * EPOCH
    segments = list(f.segments)
    path = plan(lla, f.speed, heading, segments, dt)
    if path.duration < needed - 0.5 * dt:
        onwards = Straight(duration=needed - path.duration + dt)
        path = plan(lla, f.speed, heading, [*segments, onwards], dt)
    return path
