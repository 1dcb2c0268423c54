"""Columns as the tables of other packages, where those are installed. FTLab needs none of them."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

Columns = Mapping[str, NDArray[Any]]


def needed(package: str, what: str) -> Any:
    """A package that is not among FTLab's own needs.

    Raises:
        ImportError: it is not installed; the message names it and how to get it.
    """
    try:
        return import_module(package)
    except ImportError as error:
        name = package.partition(".")[0]
        raise ImportError(f"{what} needs the package {name}, which cannot be imported: pip install {name}") from error


def to_pandas(columns: Columns, units: Mapping[str, str]) -> Any:
    """A ``pandas.DataFrame``; the units are in ``.attrs["units"]``, column -> unit. Raises ImportError."""
    pandas = needed("pandas", "to_pandas()")
    frame = pandas.DataFrame({name: np.array(values) for name, values in columns.items()})
    frame.attrs["units"] = dict(units)
    return frame


def to_polars(columns: Columns) -> Any:
    """A ``polars.DataFrame``. Raises ImportError."""
    polars = needed("polars", "to_polars()")
    return polars.DataFrame({name: np.array(values) for name, values in columns.items()})


def to_xarray(
    time: NDArray[np.float64], runs: NDArray[np.int64], columns: Columns, attributes: Mapping[str, Mapping[str, str]]
) -> Any:
    """An ``xarray.Dataset`` over time and run.

    Args:
        time: ``(epochs,)`` [s].
        runs: numbers of the runs ``(runs,)``.
        columns: name -> ``(epochs, runs)``.
        attributes: name -> what is known of a column, its unit above all.

    Raises:
        ImportError: xarray is not installed.
    """
    xarray = needed("xarray", "to_xarray()")
    variables = {name: (("time", "run"), values, dict(attributes[name])) for name, values in columns.items()}
    return xarray.Dataset(variables, coords={"time": ("time", time, {"units": "s"}), "run": ("run", runs)})
