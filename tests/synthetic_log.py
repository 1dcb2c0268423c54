"""A receiver's log made for tests: RINEX files of a receiver in Seoul under the nominal constellation.

The orbits come from :mod:`ftcore.world.constellation`, not from the code that reads ephemerides; the navigation file
says the same orbits in the words of a broadcast message.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from ftcore import earth
from ftcore.estimation import atmosphere
from ftcore.sensors import broadcast
from ftcore.world import constellation

LLA = np.array([math.radians(37.5665), math.radians(126.978), 50.0])
ANTENNA = earth.geodetic_to_ecef(LLA)
START = datetime(2026, 3, 4, 10, 0, 0)
"""A Wednesday."""
_SUNDAY = datetime(2026, 3, 1)
_SKY = 1800.0
"""Time of the constellation at the start: Seoul sees eight satellites [s]."""
_CLOCK = 1e-5
"""Clock error of the first satellite [s]; the k-th has k times it."""


@dataclass(frozen=True)
class Files:
    """Contents of an observation file and its navigation file, and where the antenna stands (3,) [m]."""

    observation: bytes
    navigation: bytes
    antenna: tuple[float, float, float]

    @property
    def position(self) -> str:
        """The antenna's position as a person types it."""
        return ", ".join(f"{part:.3f}" for part in self.antenna)


def files(
    epochs: int = 40,
    interval: float = 30.0,
    noise: float = 0.5,
    seed: int = 1,
    position: bool = True,
    days: int = 0,
    steps: int = 0,
    path: Callable[[float], tuple[float, float, float]] | None = None,
) -> Files:
    """A log of so many epochs.

    ``position``: the header has the antenna's; ``days``: later by so many; ``steps``: milliseconds that the receiver's
    clock is set back by in the middle; ``path``: where the receiver is after so many seconds, east, north, up of the
    antenna's position [m].
    """
    rng = np.random.default_rng(seed)
    start = START + timedelta(days=days)
    times = interval * np.arange(epochs)
    lines = [
        _header("     2.11           OBSERVATION DATA    G (GPS)", "RINEX VERSION / TYPE"),
        _header("     1    C1", "# / TYPES OF OBSERV"),
        _header(f"{interval:10.3f}", "INTERVAL"),
        _header(f"{start:  %Y    %m    %d    %H    %M}    0.0000000     GPS", "TIME OF FIRST OBS"),
    ]
    if position:
        lines.append(_header("".join(f"{part:14.4f}" for part in ANTENNA), "APPROX POSITION XYZ"))
    lines.append(_header("", "END OF HEADER"))
    for t in times.tolist():
        moment = start + timedelta(seconds=t)
        seen, ranges = _pseudoranges(t, (0.0, 0.0, 0.0) if path is None else path(t))
        ranges = ranges + noise * rng.standard_normal(len(ranges))
        if 2.0 * t >= times[-1]:
            ranges = ranges - steps * 1e-3 * earth.SPEED_OF_LIGHT
        second = moment.second + moment.microsecond * 1e-6
        names = "".join(f"G{slot + 1:02d}" for slot in seen)
        lines.append(f"{moment: %y %m %d %H %M}{second:11.7f}  0{len(seen):3d}{names}")
        lines += [f"{value:14.3f}  " for value in ranges]
    observation = "\n".join(lines) + "\n"
    return Files(observation.encode(), _navigation(start, float(times[-1])), tuple(ANTENNA.tolist()))


def _pseudoranges(t: float, away: tuple[float, float, float]) -> tuple[list[int], np.ndarray]:
    """Slots in view ``t`` seconds after the start, and what a receiver with a clock of its own measures [m]."""
    clock = 3e-4 + 1e-8 * t
    antenna = ANTENNA + earth.enu_to_ecef_matrix(LLA[0], LLA[1]) @ np.array(away)
    place = earth.ecef_to_geodetic(antenna)
    travel = np.full(len(constellation.almanac().names), 0.075)
    for _ in range(3):
        satellite = np.stack(
            [constellation.satellite_states(_SKY + t - clock - one)[0][i] for i, one in enumerate(travel.tolist())]
        )
        sight = constellation.line_of_sight(place, satellite)
        turn = (satellite[:, 0] * antenna[1] - satellite[:, 1] * antenna[0]) * (earth.RATE / earth.SPEED_OF_LIGHT)
        distance = sight.range + turn
        travel = distance / earth.SPEED_OF_LIGHT
    seen = np.flatnonzero(sight.visible(8.0))
    troposphere = atmosphere.saastamoinen(place[0], place[2], sight.elevation[seen])
    own = earth.SPEED_OF_LIGHT * (clock - _CLOCK * (seen + 1))
    return seen.tolist(), distance[seen] + troposphere + own


def _navigation(start: datetime, until: float) -> bytes:
    """Ephemerides every two hours."""
    lines = [
        _header("     2.11           N: GPS NAV DATA", "RINEX VERSION / TYPE"),
        _header("", "END OF HEADER"),
    ]
    slots = constellation.almanac()
    radius, rate = constellation.SEMI_MAJOR_AXIS, constellation.MEAN_MOTION
    for k in range(int(until // 7200.0) + 1):
        moment, since = start + timedelta(hours=2 * k), _SKY + 7200.0 * k
        toe = (moment - _SUNDAY).total_seconds() % 604800.0
        for i in range(len(slots.names)):
            argument = math.remainder(slots.argument[i] + rate * since, 2.0 * math.pi)
            node = math.remainder(slots.node[i] - earth.RATE * since + broadcast.OMEGA_E * toe, 2.0 * math.pi)
            delta_n = rate - math.sqrt(broadcast.MU / radius**3)
            rows = [
                (0.0, 0.0, delta_n, argument),  # IODE, Crs, Delta n, M0
                (0.0, 0.0, 0.0, math.sqrt(radius)),  # Cuc, e, Cus, sqrt(A)
                (toe, 0.0, node, 0.0),  # Toe, Cic, Omega0, Cis
                (constellation.INCLINATION, 0.0, 0.0, broadcast.OMEGA_E - earth.RATE),  # i0, Crc, omega, Omega dot
                (0.0, 1.0, 2408.0, 0.0),  # IDOT, codes, week, L2P
                (2.0, 0.0, 0.0, 0.0),  # accuracy, health, TGD, IODC
                (toe, 4.0),  # transmission time, fit interval
            ]
            lines.append(f"{i + 1:2d}{moment: %y %m %d %H %M}{0.0:5.1f}{_row((_CLOCK * (i + 1), 0.0, 0.0))}")
            lines += [f"   {_row(row)}" for row in rows]
    return ("\n".join(lines) + "\n").encode()


def _header(text: str, label: str) -> str:
    return f"{text:60s}{label}"


def _row(values: tuple[float, ...]) -> str:
    return "".join(f"{value:19.12E}".replace("E", "D") for value in values)
