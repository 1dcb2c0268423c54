"""The one shape every test answers in, so that a person can always see why."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class TestResult:
    """What one test says of one subject in every run.

    `alarm` is `statistic` against `threshold`; a test whose alarm asks for more than that says so where it is made.
    """

    __test__: ClassVar[bool] = False  # a test of sensors, not one that pytest should collect

    name: str
    """Which test, as `residual` or `parity`."""
    subject: str
    """Who is judged, as `gps` or `gyro 2`."""
    statistic: Array
    """(runs,)."""
    dof: Ints
    """Degrees of freedom of the statistic without a fault, (runs,); 0 where there was nothing to judge."""
    threshold: Array
    """(runs,), in units of the statistic."""
    alarm: Mask
    """(runs,)."""
    innovation: Array | None = None
    """The vector behind the statistic, (runs, m), where there is one."""
    covariance: Array | None = None
    """Its covariance without a fault, (runs, m, m)."""
    extra: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Further numbers of the test's own, each (runs, ...)."""
