"""The published tables of the low-speed F-16, looked up for any number of aircraft at once.

Source: B.L. Stevens and F.L. Lewis, Aircraft Control and Simulation, appendix A, reduced from NASA TP-1538. The figures
stand in ``f16_stevens_lewis.json`` in the units they were published in; angles go in as radians here, Mach and altitude
as Mach and metres, and thrust comes out in newtons.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FOOT = 0.3048
POUND_FORCE = 4.4482216152605
SLUG = POUND_FORCE / FOOT
SLUG_FT2 = SLUG * FOOT**2

_OF_ALPHA = ("CZ", "CXq", "CZq", "Cmq", "CYr", "Clr", "Cnr", "CYp", "Clp", "Cnp")
_SURFACES = (
    ("CX", "Cm"),
    ("Cl", "Cn"),
    ("Cl_aileron", "Cn_aileron", "Cl_rudder", "Cn_rudder"),
    ("thrust_idle_lbf", "thrust_military_lbf", "thrust_maximum_lbf"),
)
_WIDTH = 4
_ALPHA = 4
"""Row of the variables where alpha first stands."""


@lru_cache(maxsize=1)
def published() -> dict[str, Any]:
    """The data file as it is: constants, tables, check point, in published units."""
    text = (resources.files("ftcore.world") / "f16_stevens_lewis.json").read_text("utf-8")
    data: dict[str, Any] = json.loads(text)
    return data


@dataclass(frozen=True)
class Tables:
    """All tables, prepared so that one look-up reads them all.

    A function of two variables is bilinear in each cell: 1, x, y and x y terms. Four groups of such functions share
    their two variables: (CX, Cm) of elevator and alpha, (Cl, Cn) of the magnitude of beta and alpha, (Cl, Cn for 20 deg
    of aileron, Cl, Cn for 30 deg of rudder) of beta and alpha, and thrust (idle, military, maximum) of Mach number and
    altitude. The variables come in that order, rows first: elevator, |beta|, beta, Mach, alpha, alpha, alpha, altitude.
    """

    first: Array
    """First value on each variable's axis, (8, 1)."""
    per_unit: Array
    """Cells per unit of each variable, (8, 1)."""
    last_cell: Array
    """Last cell on each axis, (8, 1)."""
    columns: NDArray[np.int64]
    """Cells in a row of each group, (4, 1)."""
    offset: NDArray[np.int64]
    """Where each group's cells begin, (4, 1)."""
    terms: Array
    """(4 terms, 4 functions, cells)."""
    of_alpha: Array
    """Start and slope in each cell of CZ and of what q, r and p do to it: (2, 10, 11), in the order of _OF_ALPHA."""

    def look_up(self, variables: Array) -> tuple[Array, Array]:
        """Values for variables ``(8, n)``: the functions of two ``(4 groups, 4, n)``, those of alpha ``(10, n)``.

        Outside the published range the edge cell goes on.
        """
        place = variables - self.first
        place *= self.per_unit
        cell = np.minimum(np.maximum(place, 0.0), self.last_cell).astype(np.int64)
        place -= cell
        index = cell[:_ALPHA] * self.columns
        index += cell[_ALPHA:]
        index += self.offset
        one, along_x, along_y, both = self.terms.take(index, axis=-1)
        y, x = place[:_ALPHA], place[_ALPHA:]
        both *= x
        both += along_y
        both *= y
        along_x *= x
        one += along_x
        one += both
        start, slope = self.of_alpha.take(cell[_ALPHA], axis=-1)
        slope *= x[0]
        slope += start
        return one.swapaxes(0, 1), slope


@lru_cache(maxsize=1)
def tables() -> Tables:
    """The published tables; read-only."""
    t = published()["tables"]
    degree = np.pi / 180.0
    groups = [[t[name] for name in names] for names in _SURFACES]
    units = [(degree, degree)] * 3 + [(1.0, FOOT)]
    axes = [_axis(group[0]["axes"][0], unit[0]) for group, unit in zip(groups, units, strict=True)]
    axes += [_axis(group[0]["axes"][1], unit[1]) for group, unit in zip(groups, units, strict=True)]
    first, spacing, cells = np.array(axes).T
    terms = [_terms(group, scale) for group, scale in zip(groups, (1.0, 1.0, 1.0, POUND_FORCE), strict=True)]
    curves = np.array([t[name]["values"] for name in _OF_ALPHA], dtype=float)
    made = Tables(
        first=first[:, None],
        per_unit=1.0 / spacing[:, None],
        last_cell=cells[:, None] - 1.0,
        columns=cells[4:, None].astype(np.int64),
        offset=np.cumsum([0] + [part.shape[-1] for part in terms[:-1]])[:, None],
        terms=np.concatenate(terms, axis=-1),
        of_alpha=np.stack([curves[:, :-1], np.diff(curves)]),
    )
    for array in (made.first, made.per_unit, made.last_cell, made.columns, made.offset, made.terms, made.of_alpha):
        array.flags.writeable = False
    return made


def _axis(named: list[Any], unit: float) -> tuple[float, float, float]:
    """First value, spacing and number of cells of an axis. Raises ValueError unless it is evenly spaced."""
    name, values = named
    steps = np.diff(values)
    if not np.allclose(steps, steps[0]):
        raise ValueError(f"the axis {name} of the F-16 tables is not evenly spaced: {values}")
    return float(values[0]) * unit, float(steps[0]) * unit, float(len(values) - 1)


def _terms(members: list[dict[str, Any]], unit: float) -> Array:
    """Terms of the functions of one group in every cell, (4, 4, cells); functions that are not there are 0."""
    z = np.array([m["values"] for m in members], dtype=float) * unit
    one = z[:, :-1, :-1]
    along_x = z[:, :-1, 1:] - one
    along_y = z[:, 1:, :-1] - one
    both = z[:, 1:, 1:] - z[:, 1:, :-1] - along_x
    terms = np.zeros((4, _WIDTH, one[0].size))
    terms[:, : len(members)] = np.stack([one, along_x, along_y, both]).reshape(4, len(members), -1)
    return terms
