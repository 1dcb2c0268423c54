"""Sensors and sky of the SINS/GPS/BD2/CNS system: star tracker, position receivers, phases of manoeuvre, BD2."""

import numpy as np
import pytest

from ftcore import earth
from ftcore.noise import NoiseSource
from ftcore.rotation import matrix_to_rpy, rotvec_to_matrix, rpy_to_matrix
from ftcore.sensors import positioning, star_tracker
from ftcore.sensors.inertial import AxisCluster
from ftcore.systems.sins_gps_bd2_cns.measurements import Chart, attitude_rows
from ftcore.world import beidou
from ftcore.world.manoeuvres import hour, length, phase
from ftcore.world.trajectory import SpeedChange, build

ARCSEC = np.pi / 180.0 / 3600.0
RUNS = 4000


def test_star_tracker_noise_is_white_of_the_size_asked_for():
    """Standard deviation of 12000 numbers: 4 sigma is 2.6 %; false failure about 1e-4, seeded."""
    noise = NoiseSource(5, range(RUNS))
    rpy = np.array([[0.1, -0.05, 6.28]])
    first, second = (star_tracker.sense(rpy, 3.0 * ARCSEC, noise, epoch, float(epoch)) for epoch in (1, 2))
    assert first.values.shape == (RUNS, 3)
    assert first.valid.all()
    for group in (first, second):
        error = (group.values - rpy) / (3.0 * ARCSEC)
        assert abs(error.std() - 1.0) < 0.026
        assert abs(error.mean()) < 4.0 / np.sqrt(error.size)
    correlation = np.mean((first.values - rpy) * (second.values - rpy)) / (3.0 * ARCSEC) ** 2
    assert abs(correlation) < 4.0 / np.sqrt(3 * RUNS)


def test_the_same_address_gives_the_same_attitude_and_position():
    noise, again = NoiseSource(5, range(3)), NoiseSource(5, range(3))
    rpy, enu = np.zeros((1, 3)), np.ones((1, 3))
    assert np.array_equal(
        star_tracker.sense(rpy, 1e-5, noise, 7, 7.0).values, star_tracker.sense(rpy, 1e-5, again, 7, 7.0).values
    )
    gps = positioning.sense("gps", enu, np.ones(3), noise, 7, 7.0).values
    assert np.array_equal(gps, positioning.sense("gps", enu, np.ones(3), again, 7, 7.0).values)
    assert not np.array_equal(gps, positioning.sense("bd2", enu, np.ones(3), again, 7, 7.0).values)


def test_positions_have_the_sigma_of_each_axis():
    noise = NoiseSource(1, range(RUNS))
    sigma = np.array([2.92, 3.06, 2.98])
    error = positioning.sense("gps", np.zeros((1, 3)), sigma, noise, 1, 1.0).values
    np.testing.assert_allclose(error.std(axis=0), sigma, rtol=0.05)


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.5, 0.1, 2.0), (-0.9, -0.3, 4.0), (0.2, 0.6, 6.2)])
def test_attitude_rows_are_the_derivative_of_roll_pitch_and_heading(rpy):
    rpy, step = np.array(rpy), 1e-6
    C = rpy_to_matrix(rpy)
    J = attitude_rows(rpy)
    for axis in range(3):
        phi = step * np.eye(3)[axis]
        ahead, back = matrix_to_rpy(rotvec_to_matrix(phi) @ C), matrix_to_rpy(rotvec_to_matrix(-phi) @ C)
        turn = ahead - back
        slope = (turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi))) / (2.0 * step)
        np.testing.assert_allclose(slope, J[:, axis], atol=1e-7)


def test_a_chart_is_metres_about_its_datum():
    datum = np.array([0.56, 2.07, 8000.0])
    chart = Chart(datum)
    r_m, r_n = earth.principal_radii(datum[0])
    moved = datum + np.array([1.0 / (r_m + datum[2]), 1.0 / ((r_n + datum[2]) * np.cos(datum[0])), 1.0])
    np.testing.assert_allclose(chart.to_metres(moved), [1.0, 1.0, 1.0], rtol=1e-8)  # a longitude resolves 3e-9 m
    across = Chart(np.array([0.0, np.pi - 1e-7, 0.0])).to_metres(np.array([0.0, -np.pi + 1e-7, 0.0]))
    assert 0.0 < across[0] < 2.0, "over the date line it is a step, not a turn of the Earth"


def test_scale_factors_multiply_what_is_felt_and_nothing_else():
    noise = NoiseSource(3, range(200))
    truth = np.tile([0.1, -0.2, 0.3], (1, 4, 1))
    times = np.arange(4.0)
    plain = AxisCluster.drawn("imu.gyro", np.eye(3), 1e-6, 1e-6, noise)
    scaled = AxisCluster.drawn("imu.gyro", np.eye(3), 1e-6, 1e-6, noise, 300e-6)
    more = scaled.sense(truth, 1, times, 0.01).values - plain.sense(truth, 1, times, 0.01).values
    np.testing.assert_allclose(more, scaled.scale[..., None] * truth[0].T, atol=1e-12)
    assert scaled.scale.std() == pytest.approx(300e-6, rel=0.15)


@pytest.mark.parametrize(("intensity", "bank"), [("high", 30.0), ("low", 5.0)])
def test_a_phase_lasts_as_long_as_asked_and_ends_at_its_speed(intensity, bank):
    segments = phase(intensity, 600.0, 150.0, bank)
    path = build(np.array([0.56, 2.07, 8000.0]), 150.0, 0.8, segments, 0.05)
    assert path.duration == pytest.approx(600.0, abs=1.0)  # every part is rounded to whole samples
    assert np.linalg.norm(path.v_n[-1]) == pytest.approx(150.0, rel=1e-6)
    worst = np.rad2deg(np.abs(path.rpy[:, 0]).max())
    assert worst == pytest.approx(bank, rel=0.35)  # a turn at a higher speed is flown at the rate of its own bank
    speed = 150.0
    for segment in segments:
        alone = build(np.array([0.56, 2.07, 8000.0]), speed, 0.8, [segment], 0.01)
        assert alone.duration == pytest.approx(length(segment, speed), abs=0.05)
        speed = segment.speed if isinstance(segment, SpeedChange) else speed


def test_the_hour_of_the_paper_turns_in_its_minutes_of_high_manoeuvre():
    segments = hour([("high", 600.0), ("low", 600.0), ("high", 1800.0), ("low", 600.0)], 150.0, 30.0, 5.0)
    path = build(np.array([0.56, 2.07, 8000.0]), 150.0, 0.8, segments, 0.05)
    assert path.duration == pytest.approx(3600.0, abs=3.0)
    bank = np.rad2deg(np.abs(path.rpy[:-1, 0]))
    share = [(bank[(path.time[:-1] > a) & (path.time[:-1] <= b)] > 15.0).mean() for a, b in ((0, 590), (610, 1190))]
    assert share[0] > 0.4
    assert share[1] == 0.0


def test_bd2_satellites_stand_where_their_orbits_say():
    day = 2.0 * np.pi / earth.RATE
    times = np.linspace(0.0, day, 97)
    positions = np.array([beidou.satellite_positions(t) for t in times])
    radius = np.linalg.norm(positions, axis=-1)
    np.testing.assert_allclose(radius[:, :10], 42_164e3, rtol=1e-4)
    np.testing.assert_allclose(radius[:, 10:], 27_906.1e3, rtol=1e-9)
    longitude = np.rad2deg(np.arctan2(positions[..., 1], positions[..., 0]))
    np.testing.assert_allclose(longitude[:, :5], np.broadcast_to(beidou.GEO_LONGITUDES, (97, 5)), atol=1e-9)
    # An inclined geosynchronous orbit draws a figure of eight about its crossing and closes it in a sidereal day.
    off = longitude[:, 5:10] - np.array([crossing for crossing, _ in beidou.IGSO])
    assert np.abs((off + 180.0) % 360.0 - 180.0).max() < 17.0
    np.testing.assert_allclose(positions[0, :10], positions[-1, :10], atol=1.0)
    latitude = np.rad2deg(np.arcsin(positions[..., 2] / radius))
    assert np.abs(latitude[:, 5:]).max() == pytest.approx(55.0, abs=0.5)
