"""The nominal constellation: orbital facts, and what is known of it from Seoul (design, systems A and B)."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from ftcore import earth
from ftcore.world import constellation

SEOUL = np.array([np.radians(37.5665), np.radians(126.978), 50.0])
SIDEREAL_DAY = 2.0 * np.pi / earth.RATE


def test_given_the_almanac_when_read_then_there_are_four_slots_in_each_of_six_planes() -> None:
    slots = constellation.almanac()
    assert len(slots.names) == 24
    assert {name[0] for name in slots.names} == set("ABCDEF")
    planes = np.unique(np.round(np.degrees(slots.node) % 360.0, 6))
    np.testing.assert_allclose(np.diff(planes), 60.0, atol=1e-6)


def test_given_any_time_when_states_are_taken_then_orbits_have_their_radius_and_inclination() -> None:
    position, _ = constellation.satellite_states(np.linspace(0.0, 43000.0, 500))
    np.testing.assert_allclose(np.linalg.norm(position, axis=-1), constellation.SEMI_MAJOR_AXIS, rtol=1e-12)
    highest = np.abs(position[..., 2]).max(axis=0) / constellation.SEMI_MAJOR_AXIS
    np.testing.assert_allclose(highest, np.sin(np.radians(55.0)), rtol=1e-3)


def test_given_a_sidereal_day_when_it_has_passed_then_satellites_are_back_over_the_same_ground() -> None:
    """Two turns in a sidereal day but for 10 s: the published axis allows for oblateness, left out here."""
    assert 4.0 * np.pi / constellation.MEAN_MOTION == pytest.approx(SIDEREAL_DAY, rel=1.5e-4)
    start, later = (constellation.satellite_states(t)[0] for t in (0.0, SIDEREAL_DAY))
    drift = np.linalg.norm(later - start, axis=-1)
    assert drift.max() < 1.5e-4 * 4.0 * np.pi * constellation.SEMI_MAJOR_AXIS


def test_given_positions_when_differentiated_then_they_move_at_the_velocity() -> None:
    t, h = np.array([0.0, 1234.5, 80000.0]), 0.5
    before, after = (constellation.satellite_states(t + d)[0] for d in (-h, h))
    np.testing.assert_allclose((after - before) / (2.0 * h), constellation.satellite_states(t)[1], atol=1e-4)


def test_given_a_day_over_seoul_when_satellites_are_counted_then_5_to_10_stand_above_5_degrees_7_6_on_average() -> None:
    position, _ = constellation.satellite_states(np.arange(0.0, 86400.0, 60.0))
    count = constellation.visible(SEOUL, position, 5.0).sum(axis=-1)
    assert (count.min(), count.max()) == (5, 10)
    assert count.mean() == pytest.approx(7.6, abs=0.05)


@pytest.mark.parametrize("step", [30.0, 60.0, 300.0, 600.0])
def test_given_whole_half_minutes_when_eight_are_first_in_view_of_seoul_then_it_is_1800_s(step: float) -> None:
    t = np.arange(0.0, 7200.0, step)
    count = constellation.visible(SEOUL, constellation.satellite_states(t)[0]).sum(axis=-1)
    assert t[np.argmax(count >= 8)] == 1800.0


def test_given_the_epoch_of_system_b_when_geometry_is_judged_then_eight_are_in_view_for_100_s_with_hdop_0_98() -> None:
    position, _ = constellation.satellite_states(np.array([1800.0, 1850.0, 1900.0]))
    sight = constellation.line_of_sight(SEOUL, position)
    seen = sight.visible(5.0)
    assert seen.sum(axis=-1).tolist() == [8, 8, 8]
    H = np.concatenate([-sight.unit_n[0][seen[0]], np.ones((8, 1))], axis=-1)
    covariance = np.linalg.inv(H.T @ H)
    assert np.sqrt(covariance[0, 0] + covariance[1, 1]) == pytest.approx(0.98, abs=0.005)


def test_given_a_user_and_satellites_when_sighted_then_pymap3d_agrees() -> None:
    users = np.stack([SEOUL, [np.radians(-40.0), np.radians(-70.0), 5000.0]])
    position, _ = constellation.satellite_states(4321.0)
    sight = constellation.line_of_sight(users, position)
    for k, (lat, lon, height) in enumerate(users):
        azimuth, elevation, distance = pymap3d.ecef2aer(*position.T, lat, lon, height, deg=False)
        np.testing.assert_allclose(sight.range[k], distance, rtol=1e-12)
        np.testing.assert_allclose(sight.elevation[k], elevation, atol=1e-12)
        np.testing.assert_allclose(sight.azimuth[k], azimuth, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(sight.unit_n, axis=-1), 1.0, rtol=1e-14)
    assert sight.unit_n.shape == (2, 24, 3)


def test_given_a_mask_when_it_is_raised_then_low_satellites_go() -> None:
    position, _ = constellation.satellite_states(0.0)
    sight = constellation.line_of_sight(SEOUL, position)
    for mask in (0.0, 5.0, 15.0, 40.0):
        np.testing.assert_array_equal(sight.visible(mask), np.degrees(sight.elevation) > mask)


def test_given_the_almanac_when_someone_writes_to_it_then_it_refuses() -> None:
    with pytest.raises(ValueError, match="read-only"):
        constellation.almanac().node[0] = 0.0
