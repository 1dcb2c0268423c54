"""World and sensors of the GPS receiver: the only part that knows truth. Simulated, or a real receiver's log."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore import earth
from ftcore.noise import NoiseSource
from ftcore.readings import Group, Readings
from ftcore.sensors import rinex, rinex_observation
from ftcore.sensors.gnss import Clock
from ftcore.systems.gps_receiver.estimators import Truth
from ftcore.systems.gps_receiver.forms import Log, Parameters
from ftcore.systems.gps_receiver.satellites import EPOCH, PRNS, SATELLITES, SLOTS
from ftcore.world import constellation

Array = NDArray[np.float64]

_SLOT_COLUMNS = slice(0, len(SLOTS))
_PRN_COLUMNS = slice(len(SLOTS), len(SATELLITES))


@dataclass(frozen=True)
class PlantState:
    """What the plant carries from epoch to epoch."""

    clock: Clock


class SimulatedPlant:
    """See :class:`ftcore.systems.base.Plant`. A receiver that stands still under the nominal constellation."""

    def __init__(self, p: Parameters, noise: NoiseSource) -> None:
        self._p = p
        self._noise = noise
        r = p.receiver
        lla = np.array([math.radians(r.latitude), math.radians(r.longitude), r.height])
        self._truth = standing(earth.geodetic_to_ecef(lla))

    def initial(self) -> PlantState:
        """Before the first epoch."""
        r, draw = self._p.receiver, self._noise.normal
        phase = r.clock_phase * draw("gps.clock.phase", 0)
        return PlantState(Clock(phase, r.clock_frequency * draw("gps.clock.frequency", 0)))

    def step(self, state: PlantState, epoch: int, command: object) -> tuple[PlantState, Truth, Readings]:
        """One epoch: what the receiver measures."""
        p, now = self._p, epoch * EPOCH
        clock = state.clock.step(EPOCH, p.filter.clock_phase_noise, p.filter.clock_frequency_noise, self._noise, epoch)
        position, _ = constellation.satellite_states(p.receiver.constellation_time + now)
        sight = constellation.seen_from(self._truth.position_e[0], self._truth.C_en[0], position)
        # The Earth turns while the signal travels; the receiver reckons with it.
        x, y, _ = self._truth.position_e[0]
        turn = (position[:, 0] * y - position[:, 1] * x) * (earth.RATE / earth.SPEED_OF_LIGHT)
        white = self._noise.normal("gps.pseudorange", epoch, (len(SLOTS),))
        values = np.zeros((len(clock.phase), len(SATELLITES)))
        values[:, _SLOT_COLUMNS] = sight.range + turn + clock.phase[:, None] + p.receiver.pseudorange * white
        valid = np.zeros((1, len(SATELLITES)), bool)
        valid[0, _SLOT_COLUMNS] = sight.visible(p.mask)
        satellites = np.zeros((len(SATELLITES), 3))
        satellites[_SLOT_COLUMNS] = position
        aiding = {"satellites": satellites, "clock": np.zeros(len(SATELLITES)), "time": np.asarray(now)}
        groups = {"gps.pseudorange": Group(values, valid, np.asarray(now))}
        return PlantState(clock), self._truth, Readings(now, groups, aiding)

    def visible(self, channel: str, start: float, end: float) -> bool:
        """See :attr:`ftcore.systems.base.Assembly.visible`."""
        part = channel.rsplit(".", 1)[-1]
        if part not in SLOTS:
            return True
        times = np.linspace(start, end, 2 + int((end - start) / constellation.LOOKS))
        lla = earth.ecef_to_geodetic(self._truth.position_e[0])
        since = self._p.receiver.constellation_time + times
        return constellation.may_be_visible(SLOTS.index(part), lla, since, self._p.mask)


class LogPlant:
    """See :class:`ftcore.systems.base.Plant`. Plays a receiver's log, one of its epochs an epoch.

    The pseudoranges are the receiver's; all runs see the same, and only what the operator lays over them differs. A
    pseudorange that the log lacks is not valid, and reads as the last one before: that is what a stuck or late reading
    goes back to. After the log's end there are no readings.
    """

    def __init__(self, log: rinex.ObservationLog, p: Log, runs: int, mask: float = 0.0) -> None:
        self._log = log
        self._mask = mask
        self._runs = runs
        self._truth = standing(reference(log, p))
        self._pseudorange = held(log.pseudorange)

    def initial(self) -> PlantState:
        """Before the first epoch."""
        return PlantState(Clock(np.zeros(1), np.zeros(1)))

    def step(self, state: PlantState, epoch: int, command: object) -> tuple[PlantState, Truth, Readings]:
        """One epoch of the log."""
        log, now, row = self._log, epoch * self._log.interval, epoch - 1
        values = np.zeros((1, len(SATELLITES)))
        valid = np.zeros((1, len(SATELLITES)), bool)
        satellites = np.zeros((len(SATELLITES), 3))
        clock = np.zeros(len(SATELLITES))
        time = log.week_seconds[-1] + log.interval * (epoch - len(log))
        if row < len(log):
            time = log.week_seconds[row]
            values[0, _PRN_COLUMNS] = self._pseudorange[row]
            valid[0, _PRN_COLUMNS] = np.isfinite(log.pseudorange[row])
            satellites[_PRN_COLUMNS] = np.nan_to_num(log.satellites[row])
            clock[_PRN_COLUMNS] = np.nan_to_num(log.clock[row])
        aiding = {"satellites": satellites, "clock": clock, "time": np.asarray(time)}
        if log.ionosphere is not None:
            aiding["ionosphere"] = log.ionosphere
        values = np.repeat(values, self._runs, axis=0)
        groups = {"gps.pseudorange": Group(values, valid, np.asarray(now))}
        return state, self._truth, Readings(now, groups, aiding)

    def visible(self, channel: str, start: float, end: float) -> bool:
        """See :attr:`ftcore.systems.base.Assembly.visible`: the log has a pseudorange of it, above the mask by 2 deg.

        The navigator puts the mask at its own position; the antenna's may be wrong by what this allows for, 200 km.
        """
        part = channel.rsplit(".", 1)[-1]
        if part not in PRNS:
            return True
        log, column = self._log, PRNS.index(part)
        rows = slice(max(0, round(start / log.interval) - 1), max(0, round(end / log.interval)))
        there = np.isfinite(log.pseudorange[rows, column])
        if not there.any():
            return False
        at = log.satellites[rows, column][there]
        elevation = constellation.seen_from(self._truth.position_e[0], self._truth.C_en[0], at).elevation
        return bool((elevation > math.radians(self._mask - 2.0)).any())


def held(values: Array) -> Array:
    """Columns ``(epochs, n)`` with every gap (NaN) at the value before it, at the first value after it at the start."""
    known = np.isfinite(values)
    epochs = np.arange(len(values))[:, None]
    before = np.maximum.accumulate(np.where(known, epochs, -1), axis=0)
    source = np.where(before < 0, known.argmax(axis=0), before)
    return np.nan_to_num(np.take_along_axis(values, source, axis=0))


def standing(position_e: Array) -> Truth:
    """Truth of a receiver that stands at ``position_e (3,)``."""
    lla = earth.ecef_to_geodetic(position_e)
    return Truth(position_e[None], earth.enu_to_ecef_matrix(lla[:1], lla[1:2]))


def reference(log: rinex.ObservationLog, p: Log) -> Array:
    """Where the antenna is taken to stand (3,): as given, or as the file's header has it, which is good to metres.

    Raises:
        LogError: neither is known, or what is given is not on the Earth.
    """
    if p.antenna is None:
        if log.approximate is None:
            raise rinex.LogError(
                "the observation file gives no approximate position; give the antenna's position", "antenna"
            )
        return log.approximate
    position = np.array(p.antenna)
    if not 6.3e6 < float(np.linalg.norm(position)) < 6.5e6:
        raise rinex.LogError(
            "the antenna's position is not near the Earth's surface; Earth-fixed metres are wanted", "antenna"
        )
    return position


assert len(PRNS) == rinex_observation.PRNS
