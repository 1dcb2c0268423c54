"""What is compared in speed must do the same work: our figures and the peers' agree."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench import covariance, integrated


def test_given_the_same_matrices_then_our_cycle_gives_what_filterpy_gives() -> None:
    """Each in units of its sigma. filterpy inverts S and multiplies out the Joseph form; that is what 1e-6 is for."""
    cycle = covariance.real_cycle(runs=5)
    filters = cycle.filterpy()
    cycle.theirs(filters)
    ours = cycle.ours()
    sigma = np.sqrt(np.diagonal(ours.P, axis1=-2, axis2=-1))
    for k, theirs in enumerate(filters):
        np.testing.assert_allclose(ours.x[k] / sigma[k], theirs.x / sigma[k], rtol=0.0, atol=1e-6)
        unit = np.outer(sigma[k], sigma[k])
        np.testing.assert_allclose(ours.P[k] / unit, theirs.P / unit, rtol=0.0, atol=1e-6)


@pytest.mark.long
def test_given_the_same_imu_data_then_pyins_and_we_end_at_the_same_place() -> None:
    """GPS is good to 3 m, and both filters see it every second."""
    _, _, apart = integrated.compare(tries=1)
    assert apart < 5.0
