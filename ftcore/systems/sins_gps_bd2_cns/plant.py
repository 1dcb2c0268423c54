"""World and sensors of the SINS/GPS/BD2/CNS system: the only part that knows truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftcore import earth, units
from ftcore.estimation.strapdown import InsState
from ftcore.noise import NoiseSource
from ftcore.parts.navigation import Truth
from ftcore.readings import Group, Readings
from ftcore.rotation import rotvec_to_matrix, rpy_to_matrix
from ftcore.sensors import positioning, star_tracker
from ftcore.sensors.inertial import AxisCluster
from ftcore.systems.sins_gps_bd2_cns.forms import EPOCH, Flight, Parameters
from ftcore.systems.sins_gps_bd2_cns.inertial import AXES, BODY
from ftcore.systems.sins_gps_bd2_cns.measurements import Chart
from ftcore.world import manoeuvres
from ftcore.world.path import Path
from ftcore.world.trajectory import Segment, Straight, plan

Array = NDArray[np.float64]


class Plant:
    """See :class:`ftcore.systems.base.Plant`. All runs fly the same path, each with its own sensors.

    GPS and BD2 hand out positions with the errors of Yang 2016's Table 2; their constellations are there for the scene.
    """

    def __init__(self, p: Parameters, axes: Array, duration: float, noise: NoiseSource) -> None:
        self._p = p
        self._noise = noise
        self.samples = max(1, round(p.inertial.rate * EPOCH))
        self.dt = EPOCH / self.samples
        self.path = fly(p.flight, duration, self.dt)
        self.chart = datum(p.flight)
        self._times: Array = (np.arange(self.samples, dtype=np.float64) + 0.5) * self.dt
        i = p.inertial
        self._fitted = slice(0, len(BODY)) if i.configuration == "three-axis" else slice(len(BODY), len(AXES))
        self._has_reading = np.zeros((1, len(AXES)), bool)
        self._has_reading[:, self._fitted] = True
        kinds = (
            ("gyro", i.gyro_bias, "deg/h", i.angle_random_walk, "deg/sqrt(h)"),
            ("accelerometer", i.accelerometer_bias, "ug", i.accelerometer_noise, "ug/sqrt(Hz)"),
        )
        self.clusters = [
            AxisCluster.drawn(
                f"imu.{name}",
                axes,
                units.to_si(bias, unit),
                units.to_si(density, density_unit),
                noise,
                units.to_si(i.scale_factor, "ppm"),
            )
            for name, bias, unit, density, density_unit in kinds
        ]
        self._sigma = {name: np.array(sigma) for name, sigma in (("gps", p.aiding.gps), ("bd2", p.aiding.bd2))}
        self._cns = units.to_si(p.aiding.cns, "arcsec")

    def initial(self) -> None:
        """The plant carries nothing from epoch to epoch: all its noise is addressed."""
        return

    def step(self, state: None, epoch: int, command: object) -> tuple[None, Truth, Readings]:
        """One epoch: where the aircraft is at its end, and what the sensors say."""
        t = self.path.between((epoch - 1) * self.samples, epoch * self.samples)
        now, rpy = epoch * EPOCH, t.rpy[-1:]
        truth = Truth(t.lla[-1:], t.v_n[-1:], rpy_to_matrix(rpy), rpy)
        times = np.add(now - EPOCH, self._times)
        gyro, accelerometer = self.clusters
        enu = self.chart.to_metres(truth.lla)
        groups = {
            "imu.gyro": self._inertial(gyro.sense(t.omega_b[None], epoch, times, self.dt)),
            "imu.accelerometer": self._inertial(accelerometer.sense(t.f_b[None], epoch, times, self.dt)),
            "gps.position": positioning.sense("gps", enu, self._sigma["gps"], self._noise, epoch, now),
            "bd2.position": positioning.sense("bd2", enu, self._sigma["bd2"], self._noise, epoch, now),
            "cns.attitude": star_tracker.sense(rpy, self._cns, self._noise, epoch, now),
        }
        return None, truth, Readings(now, groups)

    def _inertial(self, fitted: Group) -> Group:
        """The group of all axes there could be, of which those of the IMU that is fitted have a reading."""
        values = np.zeros((len(fitted.values), len(AXES), self.samples))
        values[:, self._fitted] = fitted.values
        return Group(values, self._has_reading, fitted.times)

    def alignment(self) -> InsState:
        """What the navigator is told at the start: the truth with the alignment's errors, ``(runs, ...)``."""
        initial, t, draw = self._p.initial, self.path.between(0, 1), self._noise.normal
        r_m, r_n = earth.principal_radii(t.lla[0, 0])
        metres = initial.position * draw("initial.position", 0, (3,))
        radius = np.array([(r_n + t.lla[0, 2]) * math.cos(t.lla[0, 0]), r_m + t.lla[0, 2], 1.0])
        east, north, up = np.moveaxis(metres / radius, -1, 0)
        lla = t.lla[0] + np.stack([north, east, up], axis=-1)
        v_n = t.v_n[0] + initial.velocity * draw("initial.velocity", 0, (3,))
        tilt = np.array([initial.tilt, initial.tilt, initial.azimuth]) * draw("initial.attitude", 0, (3,))
        return InsState(lla, v_n, rotvec_to_matrix(tilt) @ rpy_to_matrix(t.rpy[0]))

    def calibration(self) -> Array:
        """Mean readings of all axes over a standstill before the flight, level, gyros and accelerometers
        ``(runs, 2, k)``."""
        seconds = self._p.inertial.calibration
        felt = (np.zeros(3), np.array([0.0, 0.0, -earth.STANDARD_GRAVITY]))
        return np.stack([c.calibrate(x, seconds) for c, x in zip(self.clusters, felt, strict=True)], axis=1)


def datum(f: Flight) -> Chart:
    """Positions are metres about the start of the flight; the navigator knows where that is."""
    return Chart(np.array([math.radians(f.latitude), math.radians(f.longitude), f.height]))


@lru_cache(maxsize=4)
def fly(f: Flight, duration: float, dt: float) -> Path:
    """The path of a flight, as long as the scenario: level flight follows the last segment. Kept for branches."""
    segments: Sequence[Segment] = f.segments or manoeuvres.hour(
        [(p.intensity, p.duration) for p in f.phases], f.speed, f.high_bank, f.low_bank
    )
    needed = math.ceil(duration / EPOCH) * EPOCH
    heading = math.radians(f.heading)
    # What comes after the end of the flight need not be built; a first guess of what is needed is put right below.
    path = plan(datum(f).datum, f.speed, heading, _until(segments, f.speed, needed), dt)
    if path.duration < needed - 0.5 * dt:
        onwards = Straight(duration=needed - path.duration + dt)
        path = plan(datum(f).datum, f.speed, heading, [*_until(segments, f.speed, needed), onwards], dt)
    return path


def _until(segments: Sequence[Segment], speed: float, needed: float) -> list[Segment]:
    """The first segments, as many as it takes to fill ``needed`` seconds; at least one."""
    found: list[Segment] = []
    flown = 0.0
    for segment in segments:
        found.append(segment)
        flown += manoeuvres.length(segment, speed)
        speed = getattr(segment, "speed", speed)
        if flown >= needed:
            break
    return found or [Straight(duration=needed)]
