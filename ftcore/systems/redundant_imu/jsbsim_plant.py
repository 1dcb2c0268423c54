"""The three aircraft as JSBSim's F-16, an aircraft that nobody here wrote, under its own control laws.

Its control laws have their own, healthy rate sensors. What flies on the gyros is the pilot's part: the stick that holds
flight path and bank. So the FDI protects the flight path here, not the stability.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore import units
from ftcore.noise import NoiseSource
from ftcore.readings import Readings
from ftcore.systems.redundant_imu.aircraft import AIRCRAFT, EPOCH, Truth
from ftcore.systems.redundant_imu.flight import Mission, path_angle, trims
from ftcore.systems.redundant_imu.forms import Parameters
from ftcore.systems.redundant_imu.plant import sense
from ftcore.world.aircraft import REGULATED, C, S, f16, jsbsim_f16, steady_thrust

Array = NDArray[np.float64]

LONGEST = 1000.0
"""Seconds of the longest flight."""

_PLACE = {state: i for i, state in enumerate(REGULATED)}

PATH, HEIGHT, SINK_IN, DAMPING = 2.0, 0.3, 4.0, 3.0
"""Pitch rate wanted for an error of the path angle [1/s] and of the height [rad per second of flight], stick for the
pitch rate wanted and for its error [s/rad]. Found by trial: the mission's height is held within 3 m."""
BANK, ROLL_RATE, FULL_ROLL_RATE = 0.8, 0.1, 0.318
"""Stick for an error of bank [1/rad] and of roll rate [s/rad], and for a roll rate wanted: JSBSim's own scaling."""
YAW = -9.54
"""Stick for the yaw rate wanted [s/rad]: JSBSim's yaw damper, which would fly a turn with crossed controls, undone."""
AUTOTHROTTLE = 0.02
"""Throttle for an error of speed [s/m]."""


@dataclass(frozen=True)
class StickLaw:
    """The pilot's part: stick ``(..., 4)`` that flies a mission, from measured states in the order of REGULATED.

    The first number is the throttle of the published aircraft, the plant makes JSBSim's of it. Nothing is integrated:
    turns are flown at a steady height a little off, 3 m in the paper's at 45 degrees, some 35 m in one at 70.
    """

    mission: Mission

    def __call__(self, epoch: int, states: Array) -> Array:
        """The stick at an epoch."""
        x, u = self.mission.at(epoch)
        off = x - states
        climbing = path_angle(x) - path_angle(states)
        wanted = x[_PLACE[S.Q]] + PATH * climbing + HEIGHT * off[..., _PLACE[S.UP]] / states[..., _PLACE[S.SPEED]]
        stick = np.empty((*states.shape[:-1], 4))
        stick[..., 0] = u[C.THROTTLE] + AUTOTHROTTLE * off[..., _PLACE[S.SPEED]]
        stick[..., 1] = -SINK_IN * wanted - DAMPING * (wanted - states[..., _PLACE[S.Q]])
        stick[..., 2] = (
            BANK * off[..., _PLACE[S.ROLL]] + ROLL_RATE * off[..., _PLACE[S.P]] + FULL_ROLL_RATE * x[_PLACE[S.P]]
        )
        stick[..., 3] = YAW * x[_PLACE[S.R]]
        return np.asarray(np.clip(stick, jsbsim_f16.LOWEST_STICK, jsbsim_f16.HIGHEST_STICK))


class JsbsimPlant:
    """See :class:`ftcore.systems.base.Plant`. The command is ``(runs, 3 aircraft, 4)`` sticks of :class:`StickLaw`.

    Raises JsbsimError for a first leg that JSBSim cannot begin with, for a flight that lasts too long, or where there
    is no JSBSim.
    """

    def __init__(self, p: Parameters, axes: Array, noise: NoiseSource, duration: float) -> None:
        if duration > LONGEST:
            raise jsbsim_f16.JsbsimError(
                f"JSBSim's F-16 flies at most {LONGEST:g} s, not {duration:g}: all it was told is kept in memory",
                "duration",
            )
        self._p, self._axes, self._noise = p, axes, noise
        leg, speed = p.flight.legs[0], units.to_si(p.flight.speed, "ft/s")
        climb, heading = units.to_si(leg.climb_rate, "ft/s"), math.radians(p.flight.heading)
        self._start = jsbsim_f16.Start(speed, p.flight.height, climb, heading, EPOCH)
        self._shape = (len(noise.runs), AIRCRAFT)
        self._trim = trims(f16(), p.flight)[0]
        # Equal thrust in steady flight makes a throttle of the published aircraft one of JSBSim's.
        self._thrust, self._throttle = jsbsim_f16.throttles(speed, p.flight.height)
        self._begin = jsbsim_f16.begin(self._start, 1)

    def initial(self) -> jsbsim_f16.Flown:
        """In steady flight on the first leg."""
        return jsbsim_f16.begin(self._start, self._shape[0] * AIRCRAFT)

    def alignment(self) -> tuple[Array, Array]:
        """What the navigators are told at the start: state and controls, without errors."""
        x, u = self._begin.x[0].copy(), self._trim.u.copy()
        x[S.POWER] = self._trim.x[S.POWER]
        u[1:] = self._begin.surfaces[0]
        return np.array(np.broadcast_to(x, (*self._shape, len(x)))), np.array(np.broadcast_to(u, (*self._shape, 4)))

    def step(
        self, state: jsbsim_f16.Flown, epoch: int, command: Array | None
    ) -> tuple[jsbsim_f16.Flown, Truth, Readings]:
        """One epoch. The positions of the surfaces, which the control laws set, go with the readings."""
        told = np.zeros((*self._shape, 4)) if command is None else command.copy()
        if command is None:
            told[..., 0] = self._trim.u[C.THROTTLE]
        thrust = steady_thrust(told[..., 0], self._start.speed, self._start.height)
        told[..., 0] = np.interp(thrust, self._thrust, self._throttle)
        after = jsbsim_f16.step(state, told.reshape(-1, 4))
        truth = Truth(after.x.reshape(*self._shape, -1))
        surfaces = after.surfaces.reshape(*self._shape, -1)
        return after, truth, sense(self._p, self._axes, self._noise, truth.x, epoch, {"surfaces": surfaces})
