"""Broadcast ephemeris of GPS satellites: where a satellite was, and what its clock said, when it sent a signal.

Conventions of :mod:`ftcore.earth`; times are seconds of one continuous GPS time scale. Everything is vectorised over
what is asked for. Source: IS-GPS-200, 20.3.3.3.3.1 (clock), 20.3.3.4.3 (orbit); its own constants.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore import earth

Array = NDArray[np.float64]

MU: Final = 3.986005e14
"""Gravitational constant of the Earth as the ephemeris has it [m^3/s^2]."""
OMEGA_E: Final = 7.2921151467e-5
"""Rotation rate of the Earth as the ephemeris has it [rad/s]."""
RELATIVITY: Final = -4.442807633e-10
"""F of the relativistic clock correction [s/sqrt(m)]."""
FIT: Final = 7200.0
"""How far from its time of ephemeris a set may be used [s]."""
NEAREST, FARTHEST = 1.4e7, 4.5e7
"""Distances from the Earth's centre [m] between which a GPS satellite can be at all; others are no orbit of one."""
WEEK: Final = 604800.0
"""Seconds of a week."""

FIELDS: Final = (
    *("SVclockBias", "SVclockDrift", "SVclockDriftRate", "sqrtA", "Eccentricity", "M0", "DeltaN", "omega", "Omega0"),
    *("OmegaDot", "Io", "IDOT", "Cuc", "Cus", "Crc", "Crs", "Cic", "Cis", "Toe", "TGD", "health"),
)
"""What is needed of a navigation message."""


@dataclass(frozen=True)
class Ephemerides:
    """Sets of broadcast parameters, one an index.

    ``prn`` (k,) satellite numbers; ``toc``, ``toe`` (k,) reference times of clock and orbit, ``sent`` (k,) when the
    satellite transmitted the set as far as the file knows, all on the continuous scale [s]; ``week_second`` (k,) the
    same toe in seconds of its week, which the orbit's node is counted from; ``values``: the fields of :data:`FIELDS`,
    each (k,), SI and radians; ``ionosphere`` (8,) Klobuchar's coefficients, or None.
    """

    prn: NDArray[np.int64]
    toc: Array
    toe: Array
    sent: Array
    week_second: Array
    values: Mapping[str, Array]
    ionosphere: Array | None

    def __len__(self) -> int:
        """How many sets."""
        return len(self.prn)

    def valid(self, prn: int, time: Array) -> NDArray[np.int64]:
        """Index of the set that a satellite's users go by at each time (...), -1 where there is none.

        That is the newest one transmitted by then, as a receiver would have it; what it says of the satellite's health
        rules, whatever an older one said. Where the file knows none, as at its beginning, it is the set with the
        nearest time of ephemeris. No set is used further than :data:`FIT` from its time of ephemeris, nor where it
        says that the satellite is not healthy.
        """
        own = np.flatnonzero(self.prn == prn)
        if not len(own):
            return np.full(time.shape, -1, dtype=np.int64)
        own = own[np.argsort(self.sent[own], kind="stable")]
        newest = np.searchsorted(self.sent[own], time, side="right") - 1
        known = newest >= 0
        newest = own[np.maximum(newest, 0)]
        fits = known & (np.abs(time - self.toe[newest]) <= FIT)
        nearest = own[np.abs(time[..., None] - self.toe[own]).argmin(axis=-1)]
        chosen = np.where(fits, newest, nearest)
        usable = (np.abs(time - self.toe[chosen]) <= FIT) & (self.values["health"][chosen] == 0.0)
        return np.where(usable, chosen, -1)


def states(e: Ephemerides, index: NDArray[np.int64], sent: Array) -> tuple[Array, Array]:
    """Position (..., 3) [m], Earth-fixed at the time of emission, and clock error (...) [s] of satellites.

    Args:
        index: (...) sets of ``e``.
        sent: (...) time of emission by the satellite's own clock, as a pseudorange gives it [s].

    The clock error includes relativity and the group delay of a single-frequency L1 signal; it is taken out of ``sent``
    before the orbit is evaluated.
    """
    v = {name: field[index] for name, field in e.values.items()}
    since = sent - e.toc[index]
    clock = v["SVclockBias"] + v["SVclockDrift"] * since + v["SVclockDriftRate"] * since**2
    t_k = sent - clock - e.toe[index]
    A = v["sqrtA"] ** 2
    M = v["M0"] + (np.sqrt(MU / A**3) + v["DeltaN"]) * t_k
    ecc = v["Eccentricity"]
    E = M
    # Newton on Kepler's equation: below 1e-12 rad in three turns for any GPS orbit, six for an ellipse of 0.3.
    for _ in range(6):
        E = E - (E - ecc * np.sin(E) - M) / (1.0 - ecc * np.cos(E))
    nu = np.arctan2(np.sqrt(1.0 - ecc**2) * np.sin(E), np.cos(E) - ecc)
    phi = nu + v["omega"]
    s2, c2 = np.sin(2.0 * phi), np.cos(2.0 * phi)
    u = phi + v["Cus"] * s2 + v["Cuc"] * c2
    r = A * (1.0 - ecc * np.cos(E)) + v["Crs"] * s2 + v["Crc"] * c2
    i = v["Io"] + v["IDOT"] * t_k + v["Cis"] * s2 + v["Cic"] * c2
    node = v["Omega0"] + (v["OmegaDot"] - OMEGA_E) * t_k - OMEGA_E * e.week_second[index]
    along, across = r * np.cos(u), r * np.sin(u)
    position = np.stack(
        [
            along * np.cos(node) - across * np.cos(i) * np.sin(node),
            along * np.sin(node) + across * np.cos(i) * np.cos(node),
            across * np.sin(i),
        ],
        axis=-1,
    )
    relativity = RELATIVITY * ecc * v["sqrtA"] * np.sin(E)
    return position, clock + relativity - v["TGD"]


def satellites(e: Ephemerides, time: Array, pseudorange: Array) -> tuple[Array, Array]:
    """All satellites of a log: position (epochs, s, 3) [m] and clock error in metres (epochs, s); NaN where unknown,
    or where the parameters put it where no GPS satellite can be.

    Args:
        time: (epochs,) the receiver's time tags [s].
        pseudorange: (epochs, s) by satellite number from 1 on, NaN where there is none [m]. Tag minus pseudorange / c
            is the emission by the satellite's clock, whatever the receiver's clock says.
    """
    position = np.full((*pseudorange.shape, 3), np.nan)
    clock = np.full(pseudorange.shape, np.nan)
    for s in range(pseudorange.shape[1]):
        index = e.valid(s + 1, time)
        known = np.flatnonzero((index >= 0) & np.isfinite(pseudorange[:, s]))
        if len(known):
            sent = time[known] - pseudorange[known, s] / earth.SPEED_OF_LIGHT
            with np.errstate(all="ignore"):  # parameters may be any numbers; what comes of them is judged here
                where, seconds = states(e, index[known], sent)
                radius = np.sqrt(np.vecdot(where, where))
            real = (radius > NEAREST) & (radius < FARTHEST) & (np.abs(seconds) < 1.0)
            position[known[real], s] = where[real]
            clock[known[real], s] = seconds[real] * earth.SPEED_OF_LIGHT
    return position, clock
