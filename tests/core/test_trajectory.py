"""Trajectories: they go where they are told, smoothly, and their IMU is the derivative of their truth."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import BaseModel

from ftcore import earth
from ftcore.estimation.ins_error import navigation_error
from ftcore.estimation.strapdown import InsState, propagate
from ftcore.rotation import matrix_to_rotvec, rotvec_to_matrix
from ftcore.world import path, trajectory
from ftcore.world.trajectory import Climb, Hold, Segment, SpeedChange, Straight, Trajectory, Turn, build, plan

START = (np.radians(40.0), np.radians(116.0), 5000.0)

HARD = [
    segment
    for k in range(8)
    for segment in (
        Turn(angle=90.0 * (-1) ** (k // 2), bank=60.0, entry=1.5),
        Climb(height_change=400.0 * (-1) ** k, rate=60.0, entry=1.5),
        SpeedChange(speed=250.0 if k % 2 else 320.0, acceleration=8.0, entry=1.0),
        Straight(duration=2.0),
        Turn(angle=-200.0, bank=45.0, entry=1.0),
    )
]
"""More than 600 s without rest: up to 2 g in turns, 8.7 g in pull-ups, roll rates of 90 deg/s."""


def initial(flight: Trajectory) -> InsState:
    return InsState(flight.lla[None, 0], flight.v_n[None, 0], flight.C_nb[None, 0])


def integrated_error(flight: Trajectory, seconds: float, samples: int) -> np.ndarray:
    """Error (9,) of an error-free IMU integrated by the project's strapdown."""
    state, count = initial(flight), round(seconds / flight.dt)
    for k in range(0, count, samples):
        state, _ = propagate(state, flight.omega_b[None, k : k + samples], flight.f_b[None, k : k + samples], flight.dt)
    truth = InsState(flight.lla[None, count], flight.v_n[None, count], flight.C_nb[None, count])
    return navigation_error(state, truth)[0]


@pytest.mark.parametrize(("dt", "samples"), [(0.025, 40), (0.01, 100)])
def test_given_600_s_of_hard_manoeuvre_when_a_perfect_imu_is_integrated_then_it_returns_to_the_truth(
    dt: float, samples: int
) -> None:
    flight = build(START, 300.0, 0.3, HARD, dt)
    assert flight.duration > 600.0
    error = integrated_error(flight, 600.0, samples)
    position, velocity, attitude = (float(np.linalg.norm(error[k : k + 3])) for k in (0, 3, 6))
    print(f"dt {dt} s, after 600 s: {position:.3f} m, {velocity:.2e} m/s, {attitude:.2e} rad")
    assert position < 0.3
    assert velocity < 1e-3
    assert attitude < 5e-7


def test_given_an_hour_at_rest_when_a_perfect_imu_is_integrated_then_it_stays() -> None:
    flight = build(START, 0.0, 1.0, [Hold(duration=3600.0)], 0.1)
    np.testing.assert_array_equal(flight.v_n, 0.0)
    np.testing.assert_array_equal(flight.lla, np.broadcast_to(START, flight.lla.shape))
    np.testing.assert_allclose(np.linalg.norm(flight.f_b, axis=-1), earth.gravity(START[0], START[2]), rtol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(flight.omega_b, axis=-1), earth.RATE, rtol=1e-14)
    error = integrated_error(flight, 600.0, 10)
    assert np.abs(error[:3]).max() < 0.02


def test_given_a_manoeuvre_when_truth_is_differentiated_in_ecef_then_it_is_what_the_imu_measures() -> None:
    """Oracle without the strapdown: Newton in the turning Earth frame, attitude from inertial space."""
    dt = 0.001
    flight = build(START, 250.0, 2.0, [Turn(angle=15.0, bank=50.0, entry=1.0), Climb(height_change=60, rate=40)], dt)
    p = earth.geodetic_to_ecef(flight.lla)
    C_en = earth.enu_to_ecef_matrix(flight.lla[:, 0], flight.lla[:, 1])
    spin = np.array([0.0, 0.0, earth.RATE])

    # Central differences, to second order, belong to all samples but the first and the last.
    velocity = (p[2:] - p[:-2]) / (2 * dt)
    acceleration = np.diff(velocity, axis=0) / dt
    mid = slice(1, -1)
    middle = 0.5 * (velocity[1:] + velocity[:-1])
    down_e = -C_en[..., 2] * earth.gravity(flight.lla[:, 0], flight.lla[:, 2])[:, None]
    f_e = acceleration + 2 * np.cross(spin, middle) - 0.5 * (down_e[1:-2] + down_e[2:-1])
    C_eb = C_en @ flight.C_nb
    turned = matrix_to_rotvec(np.swapaxes(C_eb[1:-2], -1, -2) @ rotvec_to_matrix(spin * dt) @ C_eb[2:-1]) / dt
    half = rotvec_to_matrix(0.5 * turned * dt)
    f_b = np.einsum("nji,nj->ni", C_eb[1:-2] @ half, f_e)
    # 1e-3 m/s^2 is what positions of 6e6 m leave of second differences at this step.
    np.testing.assert_allclose(flight.f_b[mid], f_b, rtol=0, atol=4e-3)
    np.testing.assert_allclose(flight.omega_b[mid], turned, rtol=0, atol=2e-6)


def test_given_segments_when_flown_then_each_reaches_exactly_what_it_says() -> None:
    segments = [
        Straight(duration=10.0),
        Turn(angle=-123.4, bank=35.0),
        Climb(height_change=777.0, rate=21.0),
        SpeedChange(speed=211.0, acceleration=3.3),
        Climb(height_change=-500.0, duration=60.0, entry=5.0),
        Turn(angle=1.0, rate=3.0),
        SpeedChange(speed=211.5, acceleration=10.0),
        Straight(duration=1.0),
    ]
    flight = build(START, 300.0, np.radians(90.0), segments, 0.025)
    heading = np.degrees(flight.rpy[-1, 2])
    assert heading == pytest.approx((90.0 - 123.4 + 1.0) % 360.0, abs=1e-9)
    assert flight.lla[-1, 2] == pytest.approx(5000.0 + 277.0, abs=1e-6)
    assert np.linalg.norm(flight.v_n[-1]) == pytest.approx(211.5, abs=1e-9)
    np.testing.assert_allclose(flight.rpy[-1, :2], 0.0, atol=1e-12)
    assert np.degrees(np.abs(flight.rpy[:, 0]).max()) == pytest.approx(35.0, abs=0.1)
    assert flight.v_n[:, 2].max() == pytest.approx(21.0, abs=0.03)


def test_given_level_flight_due_east_when_flown_then_it_stays_on_its_parallel_at_its_height() -> None:
    flight = build(START, 300.0, np.radians(90.0), [Straight(duration=100.0)], 0.025)
    assert flight.samples == 4000
    np.testing.assert_allclose(flight.lla[:, 0], START[0], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(flight.lla[:, 2], 5000.0)
    _, r_n = earth.principal_radii(START[0])
    travelled = (flight.lla[-1, 1] - START[1]) * (r_n + 5000.0) * np.cos(START[0])
    assert travelled == pytest.approx(30000.0, abs=1e-6)


def test_given_a_banked_turn_when_steady_then_the_seat_is_pressed_and_nobody_slides() -> None:
    flight = build(START, 200.0, 0.0, [Turn(angle=180.0, bank=60.0)], 0.025)
    steady = flight.samples // 2
    f = flight.f_b[steady]
    assert f[2] == pytest.approx(-2.0 * earth.STANDARD_GRAVITY, rel=5e-3)
    assert abs(f[1]) < 0.1  # Coriolis, and local gravity for the standard one


def test_given_any_flight_when_differentiated_twice_then_velocity_attitude_and_imu_never_jump() -> None:
    """Halving the step shrinks second differences fourfold where the slope is continuous; at a kink only twofold."""
    worst = {}
    for dt in (0.02, 0.01):
        flight = build(START, 250.0, 0.0, HARD[:5], dt)
        for name in ("v_n", "omega_b", "f_b"):
            worst[name, dt] = np.abs(np.diff(getattr(flight, name), n=2, axis=0)).max()
    for name in ("v_n", "omega_b", "f_b"):
        assert worst[name, 0.02] / worst[name, 0.01] > 3.3, name


def test_given_a_long_flight_when_made_in_blocks_then_the_joints_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = build(START, 250.0, 0.5, HARD[:5], 0.025)
    monkeypatch.setattr(path, "_BLOCK", 333)
    monkeypatch.setattr(path, "_SUMMED", 333)
    parts = build(START, 250.0, 0.5, HARD[:5], 0.025)
    np.testing.assert_allclose(parts.lla, whole.lla, rtol=0, atol=1e-13)
    np.testing.assert_allclose(parts.f_b, whole.f_b, rtol=0, atol=1e-11)


def test_given_a_flight_when_asked_for_in_any_order_then_every_piece_has_the_bits_of_the_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = build(START, 250.0, 0.5, HARD[:5], 0.025)
    monkeypatch.setattr(path, "_BLOCK", 500)
    flight = plan(START, 250.0, 0.5, HARD[:5], 0.025)
    pieces = [(480, 520), (whole.samples - 40, whole.samples), (0, 40), (1000, 2500), (500, 1000), (480, 520)]
    for start, end in pieces:
        piece = flight.between(start, end)
        for name in ("time", "lla", "v_n", "rpy"):
            np.testing.assert_array_equal(getattr(piece, name), getattr(whole, name)[start : end + 1], err_msg=name)
        for name in ("omega_b", "f_b"):
            np.testing.assert_array_equal(getattr(piece, name), getattr(whole, name)[start:end], err_msg=name)
    for start, end in ((0, 0), (-1, 5), (5, whole.samples + 1)):
        with pytest.raises(ValueError, match="do not lie"):
            flight.between(start, end)


def test_given_a_long_flight_when_planned_then_nothing_is_evaluated_yet_and_a_pole_is_refused_all_the_same() -> None:
    flight = plan(START, 250.0, 0.0, [Straight(duration=36000.0 / 250.0)], 0.01)
    assert not flight._memo
    flight.between(0, 100)
    assert list(flight._memo) == [0]
    with pytest.raises(ValueError, match="within 1 degree of a pole"):
        plan((np.deg2rad(60.0), 0.0, 5000.0), 250.0, 0.0, [Straight(duration=20000.0)], 0.01)


def test_given_a_flight_over_the_date_line_when_built_then_longitude_wraps() -> None:
    flight = build((0.1, np.pi - 1e-4, 1000.0), 300.0, np.pi / 2, [Straight(duration=10.0)], 0.1)
    assert np.abs(flight.lla[:, 1]).max() <= np.pi
    assert flight.lla[-1, 1] < 0.0


def test_given_a_takeoff_from_rest_when_built_then_it_is_smooth_from_the_first_sample() -> None:
    segments = [Hold(duration=5.0), SpeedChange(speed=80.0, acceleration=3.0), Climb(height_change=100.0, rate=8.0)]
    flight = build((0.6, 0.2, 20.0), 0.0, 1.2, segments, 0.025)
    assert np.isfinite(flight.omega_b).all()
    assert np.isfinite(flight.f_b).all()
    assert np.abs(integrated_error(flight, flight.samples // 40, 40)[:6]).max() < 1e-3


def test_given_a_trajectory_when_someone_writes_to_it_then_it_refuses() -> None:
    flight = build(START, 100.0, 0.0, [Straight(duration=1.0)], 0.1)
    for name in ("time", "lla", "v_n", "rpy", "omega_b", "f_b", "C_nb"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(flight, name)[0] = 0.0


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({"kind": "loop"}, "loop"),
        ({"duration": 100}, "kind"),
        ({"kind": "straight"}, "duration: Field required"),
        ({"kind": "straight", "duration": -1}, r"duration: .*greater than 0.*-1"),
        ({"kind": "straight", "duration": float("nan")}, "duration"),
        ({"kind": "straight", "duration": 5, "bank": 3}, "bank: Extra"),
        ({"kind": "turn", "angle": 90}, "either a bank or a rate"),
        ({"kind": "turn", "angle": 90, "bank": 89}, r"bank: .*80"),
        ({"kind": "climb", "height_change": 10, "rate": 1, "duration": 9}, "either a rate or a duration"),
        ({"kind": "climb", "height_change": 10, "duration": 4}, "no room for two entries"),
    ],
)
def test_given_a_wrong_document_when_read_then_the_message_names_what_is_wrong(document: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        trajectory.segment_from_dict(document)


def test_given_plain_documents_when_read_then_segments_come_and_go_back_the_same() -> None:
    for document in (
        {"kind": "straight", "duration": 100.0},
        {"kind": "hold", "duration": 100.0},
        {"kind": "climb", "height_change": 500.0, "rate": 10.0, "duration": None, "entry": 3.0},
        {"kind": "turn", "angle": -90.0, "bank": 30.0, "rate": None, "entry": 2.0},
        {"kind": "speed", "speed": 200.0, "acceleration": 2.0, "entry": 3.0},
    ):
        assert trajectory.segment_from_dict(document).model_dump() == document


def test_given_a_form_that_embeds_segments_when_its_schema_is_drawn_then_every_number_has_a_unit_and_a_text() -> None:
    class Form(BaseModel):
        segments: list[Segment]

    schema = Form.model_json_schema()
    assert schema["properties"]["segments"]["items"]["discriminator"]["propertyName"] == "kind"
    for kind in ("Straight", "Hold", "Climb", "Turn", "SpeedChange"):
        definition = schema["$defs"][kind]
        assert definition["additionalProperties"] is False
        for name, field in definition["properties"].items():
            if name != "kind":
                assert field["unit"], (kind, name)
                assert field["description"], (kind, name)


@pytest.mark.parametrize(
    ("speed", "segments", "message"),
    [
        (300.0, [Straight(duration=1.0), Hold(duration=5.0)], r"segments\[1\]: hold: cannot stand still at 300"),
        (0.0, [Straight(duration=1.0)], r"segments\[0\]: straight: at rest"),
        (50.0, [Climb(height_change=1000.0, rate=49.0)], r"segments\[0\]: climb: .*49 m/s.*50 m/s"),
        (100.0, [], "nothing to fly"),
        (-1.0, [Straight(duration=1.0)], "initial speed"),
        (100.0, [Straight(duration=36000.0)] * 12, "at most"),
    ],
)
def test_given_an_impossible_flight_when_built_then_it_says_why(speed: float, segments: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build(START, speed, 0.0, segments, 0.1)


def test_given_a_flight_to_the_pole_when_built_then_it_is_refused() -> None:
    with pytest.raises(ValueError, match="pole"):
        build((np.radians(88.9), 0.0, 0.0), 1000.0, 0.0, [Straight(duration=100.0)], 0.1)
    with pytest.raises(ValueError, match="dt must be positive"):
        build(START, 100.0, 0.0, [Straight(duration=1.0)], 0.0)
