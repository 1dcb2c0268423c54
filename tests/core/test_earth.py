"""WGS-84 against other people's code (pymap3d, pyins) and against differentiation."""

from __future__ import annotations

import numpy as np
import pyins.earth
import pymap3d
import pytest

from ftcore import earth

LAT = np.radians([-89.9, -60.0, -12.5, 0.0, 37.5665, 45.0, 89.9])
LON = np.radians([-179.0, -75.0, 0.0, 13.4, 126.978, 179.9, 60.0])
HEIGHT = np.array([-100.0, 0.0, 50.0, 5000.0, 12000.0, 4e5, 2.02e7])
LLA = np.stack([LAT, LON, HEIGHT], axis=-1)


def test_given_geodetic_positions_when_turned_to_ecef_then_pymap3d_agrees() -> None:
    expected = np.stack(pymap3d.geodetic2ecef(LAT, LON, HEIGHT, deg=False), axis=-1)
    np.testing.assert_allclose(earth.geodetic_to_ecef(LLA), expected, rtol=0, atol=1e-7)


def test_given_ecef_positions_up_to_satellite_height_when_turned_back_then_nothing_is_lost() -> None:
    back = earth.ecef_to_geodetic(earth.geodetic_to_ecef(LLA))
    # 1e-8 m over the radius; longitudes and latitudes as lengths.
    np.testing.assert_allclose(back[:, :2], LLA[:, :2], rtol=0, atol=3e-15)
    np.testing.assert_allclose(back[:, 2], HEIGHT, rtol=0, atol=2e-8)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_given_a_pole_when_turned_to_geodetic_then_latitude_and_height_are_right(sign: float) -> None:
    lat, _, height = earth.ecef_to_geodetic(np.array([0.0, 0.0, sign * (earth.B + 1234.0)]))
    assert lat == pytest.approx(sign * np.pi / 2, abs=1e-15)
    assert height == pytest.approx(1234.0, abs=1e-8)


def test_given_random_places_when_enu_vectors_are_turned_to_ecef_then_pymap3d_agrees() -> None:
    v = np.array([3.0, -4.0, 5.0])
    expected = np.stack(pymap3d.enu2uvw(*v, LAT, LON, deg=False), axis=-1)
    np.testing.assert_allclose(earth.enu_to_ecef_matrix(LAT, LON) @ v, expected, atol=1e-14)


def test_given_latitudes_when_radii_are_taken_then_pymap3d_agrees() -> None:
    r_m, r_n = earth.principal_radii(LAT)
    np.testing.assert_allclose(r_m, pymap3d.rcurve.meridian(LAT, deg=False), rtol=1e-12)
    np.testing.assert_allclose(r_n, pymap3d.rcurve.transverse(LAT, deg=False), rtol=1e-12)


def test_given_the_ellipsoid_when_gravity_is_taken_then_pyins_agrees_and_the_poles_have_their_value() -> None:
    np.testing.assert_allclose(earth.gravity(LAT, 0.0), pyins.earth.gravity(np.degrees(LAT), 0.0), rtol=1e-9)
    assert earth.gravity(np.pi / 2, 0.0) == pytest.approx(earth.GRAVITY_POLE, rel=1e-12)


def test_given_a_height_when_gravity_is_taken_then_it_is_the_slope_of_the_normal_potential() -> None:
    """Oracle: the series of the normal field (J2, J4, J6 of the WGS-84 ellipsoid) with the centrifugal potential."""
    lla = np.stack([LAT[:5], LON[:5], np.array([0.0, 1e3, 5e3, 1e4, 2e4])], axis=-1)

    def potential(p: np.ndarray) -> np.ndarray:
        r = np.linalg.norm(p, axis=-1)
        s, k = p[..., 2] / r, (earth.A / r) ** 2
        p2 = (3 * s**2 - 1) / 2
        p4 = (35 * s**4 - 30 * s**2 + 3) / 8
        p6 = (231 * s**6 - 315 * s**4 + 105 * s**2 - 5) / 16
        series = 1.0 - 1.08262982131e-3 * k * p2 + 2.37091120053e-6 * k**2 * p4 - 6.08346498882e-9 * k**3 * p6
        return earth.GM / r * series + 0.5 * earth.RATE**2 * (p[..., 0] ** 2 + p[..., 1] ** 2)

    position, h = earth.geodetic_to_ecef(lla), 10.0
    slope = [(potential(position + h * e) - potential(position - h * e)) / (2 * h) for e in np.eye(3)]
    expected = np.linalg.norm(slope, axis=0)
    np.testing.assert_allclose(earth.gravity(lla[:, 0], lla[:, 2]), expected, rtol=0, atol=3e-6)


def test_given_gravity_when_differentiated_then_the_gradient_agrees() -> None:
    lat, height = np.radians(np.array([-50.0, 10.0, 40.0, 75.0])), np.array([0.0, 5e3, 1e4, 2e4])
    d_lat, d_height = earth.gravity_gradient(lat, height)
    by_height = (earth.gravity(lat, height + 10.0) - earth.gravity(lat, height - 10.0)) / 20.0
    by_lat = (earth.gravity(lat + 1e-4, height) - earth.gravity(lat - 1e-4, height)) / 2e-4
    np.testing.assert_allclose(d_height, by_height, rtol=1e-7)
    np.testing.assert_allclose(d_lat, by_lat, rtol=0.01)


def test_given_a_moving_vehicle_when_the_level_frame_is_differentiated_then_it_turns_at_the_transport_rate() -> None:
    lla = np.array([np.radians(52.0), np.radians(10.0), 8000.0])
    v_n = np.array([150.0, -220.0, 0.0])
    r_m, r_n = earth.principal_radii(lla[0])
    step = 0.5
    d = np.array([v_n[1] / (r_m + lla[2]), v_n[0] / ((r_n + lla[2]) * np.cos(lla[0]))]) * step
    before, after = earth.enu_to_ecef_matrix(*(lla[:2] - d)), earth.enu_to_ecef_matrix(*(lla[:2] + d))
    turn = before.T @ after  # identity plus the skew matrix of the angle turned in two steps
    angle = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2.0
    np.testing.assert_allclose(angle / (2 * step), earth.transport_rate_n(lla[0], lla[2], v_n), rtol=1e-6, atol=1e-12)


def test_given_the_earth_axis_when_resolved_in_level_then_it_is_the_earth_rate() -> None:
    axis = np.array([0.0, 0.0, earth.RATE])
    np.testing.assert_allclose(earth.earth_rate_n(LAT), axis @ earth.enu_to_ecef_matrix(LAT, LON), rtol=0, atol=1e-19)


def test_given_any_leading_axes_when_called_then_shapes_follow() -> None:
    lla = np.tile([0.5, 1.0, 10.0], (4, 2, 1))
    assert earth.geodetic_to_ecef(lla).shape == (4, 2, 3)
    assert earth.ecef_to_geodetic(earth.geodetic_to_ecef(lla)).shape == (4, 2, 3)
    assert earth.enu_to_ecef_matrix(lla[..., 0], 1.0).shape == (4, 2, 3, 3)
    assert earth.transport_rate_n(lla[..., 0], 0.0, np.zeros(3)).shape == (4, 2, 3)
    assert earth.gravity(lla[..., 0], 5.0).shape == (4, 2)
    assert earth.earth_rate_n(0.3).shape == (3,)
