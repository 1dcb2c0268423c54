"""Rotations against scipy, numpy and plain loops."""

from __future__ import annotations

from functools import reduce

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ftcore import rotation

RNG = np.random.default_rng(20)
UNIT = RNG.normal(size=(50, 3))
UNIT /= np.linalg.norm(UNIT, axis=-1, keepdims=True)


def test_given_vectors_when_crossed_then_numpy_agrees_in_both_forms() -> None:
    a, b = RNG.normal(size=(4, 1, 3)), RNG.normal(size=(5, 3))
    expected = np.cross(a, b)
    np.testing.assert_allclose(rotation.cross(a, b), expected, atol=1e-15)
    np.testing.assert_allclose((rotation.skew(a) @ b[..., None])[..., 0], expected, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-160, 1e-12, 1e-8, 1e-5, 1e-3, 0.1, 1.0, 3.0, np.pi, 5.0, 40.0])
def test_given_a_rotation_vector_of_any_length_when_made_a_matrix_then_scipy_agrees(angle: float) -> None:
    expected = Rotation.from_rotvec(angle * UNIT).as_matrix()
    np.testing.assert_allclose(rotation.rotvec_to_matrix(angle * UNIT), expected, rtol=0, atol=4e-15 * max(1.0, angle))


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-5, 1e-3, 0.1, 1.0, 3.0, np.pi - 1e-9])
def test_given_a_matrix_when_made_a_rotation_vector_then_the_vector_comes_back(angle: float) -> None:
    back = rotation.matrix_to_rotvec(rotation.rotvec_to_matrix(angle * UNIT))
    np.testing.assert_allclose(back, angle * UNIT, rtol=0, atol=3e-15)


def test_given_half_turns_when_made_rotation_vectors_then_they_turn_back_to_the_same_matrices() -> None:
    axes = np.concatenate([np.eye(3), UNIT])
    C = rotation.rotvec_to_matrix(np.pi * axes)
    rotvec = rotation.matrix_to_rotvec(C)
    np.testing.assert_allclose(np.linalg.norm(rotvec, axis=-1), np.pi, rtol=1e-12)
    np.testing.assert_allclose(rotation.rotvec_to_matrix(rotvec), C, atol=1e-14)


def test_given_small_angles_when_coefficients_are_taken_then_they_meet_their_series() -> None:
    t2 = np.array([0.0, 1e-20, 1e-8, 1e-4])
    a, b, c = rotation.rotation_coefficients(t2)
    np.testing.assert_allclose(a, 1 - t2 / 6 + t2**2 / 120, rtol=1e-15)
    np.testing.assert_allclose(b, 0.5 - t2 / 24 + t2**2 / 720, rtol=1e-15)
    np.testing.assert_allclose(c * t2, t2 / 6 - t2**2 / 120, rtol=0, atol=4e-16)


@settings(max_examples=200, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(0.0, 6.28))
def test_given_roll_pitch_heading_when_made_a_matrix_then_scipy_agrees_and_the_angles_come_back(
    roll: float, pitch: float, heading: float
) -> None:
    C_ned_b = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix()
    enu_from_ned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    C_nb = rotation.rpy_to_matrix(np.array([roll, pitch, heading]))
    np.testing.assert_allclose(C_nb, enu_from_ned @ C_ned_b, atol=1e-15)
    np.testing.assert_allclose(rotation.matrix_to_rpy(C_nb), [roll, pitch, heading], rtol=0, atol=1e-13)


def test_given_an_aircraft_heading_east_right_wing_down_when_seen_in_level_then_its_axes_are_as_expected() -> None:
    C_nb = rotation.rpy_to_matrix(np.radians([30.0, 0.0, 90.0]))
    np.testing.assert_allclose(C_nb[:, 0], [1.0, 0.0, 0.0], atol=1e-15)  # nose east
    np.testing.assert_allclose(C_nb[:, 1], [0.0, -np.cos(np.pi / 6), -0.5], atol=1e-15)  # right wing south and down
    nose_up = rotation.rpy_to_matrix(np.radians([0.0, 20.0, 0.0]))[:, 0]
    assert nose_up[2] == pytest.approx(np.sin(np.radians(20.0)))


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_given_the_nose_straight_up_or_down_when_made_angles_then_the_same_attitude_comes_back(pitch: float) -> None:
    C_nb = rotation.rpy_to_matrix(np.array([0.3, pitch, 1.0]))
    rpy = rotation.matrix_to_rpy(C_nb)
    assert rpy[0] == 0.0
    np.testing.assert_allclose(rotation.rpy_to_matrix(rpy), C_nb, atol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 7, 8, 9, 16, 31, 40])
def test_given_a_sequence_of_rotations_when_multiplied_in_parallel_then_a_plain_loop_agrees(count: int) -> None:
    matrices = rotation.rotvec_to_matrix(RNG.normal(size=(2, 3, count, 3)))
    running = np.empty_like(matrices)
    for run in np.ndindex(2, 3):
        for i in range(count):
            running[run][i] = reduce(np.matmul, matrices[run][: i + 1])
    np.testing.assert_allclose(rotation.cumulative_product(matrices), running, atol=1e-14)
    np.testing.assert_allclose(rotation.ordered_product(matrices), running[..., -1, :, :], atol=1e-14)


def test_given_a_sequence_when_multiplied_then_the_input_is_left_alone() -> None:
    matrices = rotation.rotvec_to_matrix(RNG.normal(size=(1, 6, 3)))
    kept = matrices.copy()
    rotation.cumulative_product(matrices)
    rotation.ordered_product(matrices)
    np.testing.assert_array_equal(matrices, kept)
