"""Tables: named columns of one length, each with its unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftcore import frames
from ftcore.display import card, counted, quantity, table
from ftcore.names import unknown

SHOWN = 6
"""Columns that are named in a line; twice as many columns and rows are shown in a notebook."""

Column = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of equal length, in order; a value. A column cannot be written to.

    Attributes:
        columns: name -> values ``(n,)`` of type bool, int64, float64 or text; NaN where there is no number.
        units: name -> unit, SI; ``"1"`` for counts, flags and names.

    Raises:
        ValueError: columns of different length, or one without a unit.
    """

    columns: Mapping[str, Column]
    units: Mapping[str, str]

    def __post_init__(self) -> None:
        """Check the lengths and lock the columns."""
        if len({len(values) for values in self.columns.values()}) > 1:
            raise ValueError("the columns of a table have one length")
        if missing := [name for name in self.columns if name not in self.units]:
            raise ValueError(f"columns without a unit: {', '.join(missing)}")
        for values in self.columns.values():
            values.flags.writeable = False

    def __len__(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def __iter__(self) -> Iterator[str]:
        """Names of the columns."""
        return iter(self.columns)

    def __getitem__(self, name: str) -> Column:
        """One column ``(n,)``. Raises KeyError, naming near misses, for an unknown one."""
        if name not in self.columns:
            raise KeyError(unknown("column", name, self.columns))
        return self.columns[name]

    def __eq__(self, other: object) -> bool:
        """Whether names, units, types and every bit agree; NaN equals NaN."""
        if not isinstance(other, Table):
            return NotImplemented
        return (
            list(self.columns) == list(other.columns)
            and dict(self.units) == dict(other.units)
            and all(_same(values, other.columns[name]) for name, values in self.columns.items())
        )

    __hash__ = None  # type: ignore[assignment]

    @property
    def dtypes(self) -> dict[str, np.dtype[Any]]:
        """Name -> type of the values."""
        return {name: values.dtype for name, values in self.columns.items()}

    def __repr__(self) -> str:
        """Rows and columns, with the units of the first few."""
        names = [f"{name} [{self.units[name]}]" for name in list(self.columns)[:SHOWN]]
        more = f" and {len(self.columns) - SHOWN} more" if len(self.columns) > SHOWN else ""
        return f"<Table of {counted(len(self), 'row')}: {', '.join(names)}{more}>"

    def _repr_html_(self) -> str:
        names = list(self.columns)[: 2 * SHOWN]
        heads = [name if self.units[name] == "1" else f"{name}, {self.units[name]}" for name in names]
        rows = [[_cell(self.columns[name][i]) for name in names] for i in range(min(len(self), 2 * SHOWN))]
        whole = f"{counted(len(self), 'row')}, {counted(len(self.columns), 'column')}; to_pandas() has them all"
        return card("", whole, table("", heads, rows))

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.columns)

    def to_pandas(self) -> Any:
        """As a ``pandas.DataFrame``, units in ``.attrs["units"]``. Raises ImportError where pandas is missing."""
        return frames.to_pandas(self.columns, self.units)

    def to_polars(self) -> Any:
        """As a ``polars.DataFrame``. Raises ImportError where polars is missing."""
        return frames.to_polars(self.columns)

    def take(self, rows: Column | slice) -> Table:
        """The rows of these numbers, where this is true, or of this slice."""
        return Table({name: values[rows] for name, values in self.columns.items()}, self.units)


def stacked(tables: Sequence[Table]) -> Table:
    """Tables of the same columns, one below the other. Raises ValueError where the columns differ."""
    first = tables[0]
    for other in tables[1:]:
        differing = set(first.units.items()) ^ set(other.units.items())
        if differing:
            names = sorted({name for name, _ in differing})
            raise ValueError(f"the tables differ in the columns {', '.join(names[:6])}")
    return Table({name: np.concatenate([table[name] for table in tables]) for name in first}, first.units)


def _cell(value: Any) -> str:
    return quantity(float(value), "") if isinstance(value, np.floating) else str(value)


def _same(a: Column, b: Column) -> bool:
    if a.dtype.kind != b.dtype.kind or len(a) != len(b):
        return False
    return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))
