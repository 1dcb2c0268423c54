"""JSBSim's F-16: an aircraft that nobody here wrote, under its own control laws.

The package ``jsbsim`` (extra ``ftlab[jsbsim]``) brings the flight model and its data. Each aircraft is a simulation
object of its own, so a batch costs what its aircraft cost: the one place where runs are flown one after the other.

JSBSim keeps its state inside and cannot be put back. A :class:`Flown` is a value all the same: it knows what the sticks
were since the start, and JSBSim flies that again, to the same bits, when the objects themselves have flown on (after a
rewind, or in a fork). States are those of :class:`ftcore.world.aircraft.S`.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore.world.aircraft.dynamics import STATES, S
from ftcore.world.aircraft.tables import FOOT, POUND_FORCE

Array = NDArray[np.float64]

STEPS = 2
"""JSBSim's own steps in one of ours."""
LOWEST_STICK = np.array([0.0, -1.0, -1.0, -1.0])
"""Throttle; elevator (forward is positive), aileron (right), rudder (left), in parts of full travel."""
HIGHEST_STICK = np.array([1.0, 0.44, 1.0, 1.0])

_STATES = (
    ("velocities/vt-fps", S.SPEED, FOOT),
    ("aero/alpha-rad", S.ALPHA, 1.0),
    ("aero/beta-rad", S.BETA, 1.0),
    ("attitude/phi-rad", S.ROLL, 1.0),
    ("attitude/theta-rad", S.PITCH, 1.0),
    ("attitude/psi-rad", S.HEADING, 1.0),
    ("velocities/p-rad_sec", S.P, 1.0),
    ("velocities/q-rad_sec", S.Q, 1.0),
    ("velocities/r-rad_sec", S.R, 1.0),
    ("position/h-sl-ft", S.UP, FOOT),
    ("propulsion/engine/n2", S.POWER, 1.0),
)
# Positive JSBSim ailerons roll to the right; the tables' roll to the left.
_SURFACES = (("fcs/elevator-pos-rad", 1.0), ("fcs/aileron-pos-rad", -1.0), ("fcs/rudder-pos-rad", 1.0))
_STICK = ("fcs/throttle-cmd-norm", "fcs/elevator-cmd-norm", "fcs/aileron-cmd-norm", "fcs/rudder-cmd-norm")


class JsbsimError(ValueError):
    """JSBSim cannot fly this, or is not there; one sentence. ``field``: the part of a scenario that asked for it."""

    def __init__(self, message: str, field: str = "parameters.plant") -> None:
        super().__init__(message)
        self.field = field


@dataclass(frozen=True)
class Start:
    """Steady flight with wings level: speed [m/s], height [m], climb rate [m/s], heading [rad], step [s]."""

    speed: float
    height: float
    climb_rate: float
    heading: float
    step: float


@dataclass(frozen=True, eq=False)
class Flown:
    """A number of aircraft, flown so far.

    Attributes:
        start: how all of them began.
        before, stick: the step before, and the stick ``(n, 4)`` since; None at the start.
        x: states ``(n, 13)``; the place of power holds the engine's N2 [%].
        surfaces: elevator, aileron and rudder ``(n, 3)`` [rad], with the signs of the published tables.
        live: JSBSim's objects, if they are here now; whoever flies on takes them along.
    """

    start: Start
    before: Flown | None
    stick: Array | None
    x: Array
    surfaces: Array
    live: list[list[Any]] = field(repr=False)


def begin(start: Start, count: int) -> Flown:
    """``count`` aircraft in steady flight. Raises JsbsimError where there is no JSBSim or no such flight."""
    aircraft = [_trimmed(start) for _ in range(count)]
    return Flown(start, None, None, *_seen(aircraft, np.full((count, STATES), np.nan)), [aircraft])


def step(flown: Flown, stick: Array) -> Flown:
    """One step on, with sticks ``(n, 4)``, held within their travel. What has reached the ground stays there."""
    try:
        aircraft = flown.live.pop()
    except IndexError:
        aircraft = _again(flown)
    stick = np.minimum(np.maximum(stick, LOWEST_STICK), HIGHEST_STICK)
    _fly(aircraft, flown.x, stick)
    return Flown(flown.start, flown, stick, *_seen(aircraft, flown.x), [aircraft])


@lru_cache(maxsize=64)
def throttles(speed: float, height: float) -> tuple[Array, Array]:
    """Thrust [N], rising, and the throttle that gives it in steady flight at a speed [m/s] and height [m]."""
    _package()
    found = []
    for climb in np.linspace(-0.1, 0.5, 7) * speed:
        try:
            (aircraft,) = begin(Start(speed, height, float(climb), 0.0, 0.02), 1).live.pop()
        except JsbsimError:
            continue
        found.append((aircraft["propulsion/engine/thrust-lbs"] * POUND_FORCE, aircraft["fcs/throttle-cmd-norm"]))
    if len(found) < 2 or any(b <= a for pair in pairwise(found) for a, b in zip(*pair, strict=True)):
        raise JsbsimError(f"JSBSim's F-16 has no steady flights about {speed:g} m/s at {height:g} m")
    thrust, throttle = np.array(found).T
    return thrust, throttle


def _again(flown: Flown) -> list[Any]:
    """JSBSim's objects, flown from the start to where they were."""
    past = [flown]
    while past[-1].before is not None:
        past.append(past[-1].before)
    aircraft = [_trimmed(flown.start) for _ in range(len(flown.x))]
    for now, after in pairwise(reversed(past)):
        assert after.stick is not None
        _fly(aircraft, now.x, after.stick)
    return aircraft


def _fly(aircraft: list[Any], x: Array, stick: Array) -> None:
    for one, state, told in zip(aircraft, x.tolist(), stick.tolist(), strict=True):
        if state[S.UP] > 0.0:
            for name, value in zip(_STICK, told, strict=True):
                one[name] = value
            for _ in range(STEPS):
                one.run()


def _seen(aircraft: list[Any], before: Array) -> tuple[Array, Array]:
    """States and surfaces; of one that JSBSim lost the states before."""
    x = np.empty((len(aircraft), STATES))
    for row, one in zip(x, aircraft, strict=True):
        for name, place, unit in _STATES:
            row[place] = unit * one[name]
        # Start is on the equator and the prime meridian.
        row[S.EAST] = one["position/long-gc-rad"] * one["position/radius-to-vehicle-ft"] * FOOT
        row[S.NORTH] = one["position/lat-gc-rad"] * one["position/radius-to-vehicle-ft"] * FOOT
    surfaces = np.array([[sign * one[name] for name, sign in _SURFACES] for one in aircraft])
    lost = ~np.isfinite(x).all(axis=-1, keepdims=True)
    return np.where(lost, before, x), np.where(np.isfinite(surfaces), surfaces, 0.0)


def _trimmed(start: Start) -> Any:
    """A new aircraft in steady flight: gear up, engine running."""
    jsbsim = _package()
    one = jsbsim.FGFDMExec(os.path.dirname(jsbsim.__file__))
    one.load_model("f16")
    one.set_dt(start.step / STEPS)
    one["ic/lat-geod-deg"] = one["ic/long-gc-deg"] = 0.0
    one["ic/h-sl-ft"] = start.height / FOOT
    one["ic/vt-fps"] = start.speed / FOOT
    one["ic/gamma-rad"] = math.asin(start.climb_rate / start.speed)
    one["ic/psi-true-rad"] = start.heading % (2.0 * math.pi)
    one["gear/gear-cmd-norm"] = one["gear/gear-pos-norm"] = 0.0
    one.run_ic()
    one["propulsion/set-running"] = -1
    try:
        one["simulation/do_simple_trim"] = 1
    except jsbsim.TrimFailureError:
        raise JsbsimError(
            f"JSBSim's F-16 has no steady flight at {start.speed:g} m/s and {start.height:g} m, "
            f"climbing {start.climb_rate:g} m/s"
        ) from None
    return one


def _package() -> Any:
    try:
        jsbsim: Any = import_module("jsbsim")
    except ImportError:
        raise JsbsimError(
            "flying JSBSim's F-16 needs the package jsbsim, which is not installed: install ftlab[jsbsim]"
        ) from None
    # It would greet on the console, and complain there of flights that are refused here.
    jsbsim.FGJSBBase().debug_lvl = 0
    jsbsim.set_logger(jsbsim.DefaultLogger(jsbsim.LogLevel.FATAL))
    return jsbsim
