"""The redundant IMU on the F-16: the house's five ideas, the closed loop, and what parity space and UKF decide."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from ftcore import Fault, Scenario, Simulation, catalogue
from ftcore.faults import KINDS, largest
from ftcore.systems.redundant_imu.gyros import SUBJECTS
from tests.faulting import lay, sized
from tests.redundant_imu import bias, pair, scenario

DESCRIPTION = catalogue.system("redundant-imu")
CHANNELS = [c.name for c in DESCRIPTION.channels]
UNITS = {c.name: c.unit for c in DESCRIPTION.channels}


def isolated(sim):
    """(run, gyro) -> time."""
    found = {}
    for e in sim.events:
        if e.kind == "subsystem.isolated":
            found.setdefault((e.run, e.subject[-1]), e.time)
    return found


def same(a, b):
    return np.array_equal(a.recording.rows, b.recording.rows, equal_nan=True) and [
        e.model_dump() for e in a.events
    ] == [e.model_dump() for e in b.events]


# ---- the house's ideas


def test_given_truth_is_scrambled_after_the_readings_then_no_estimate_no_decision_and_no_command_changes():
    honest, blind = Simulation(scenario(pair(1), 1.4)), Simulation(scenario(pair(1), 1.4))
    step = blind._assembly.plant.step

    def scrambled(state, epoch, command):
        after, truth, readings = step(state, epoch, command)
        return after, replace(truth, x=np.full_like(truth.x, np.nan)), readings

    blind._assembly = replace(blind._assembly, plant=type("Scrambled", (), {"step": staticmethod(scrambled)})())
    with np.errstate(invalid="ignore"):
        honest.advance(), blind.advance()
    mine, other = honest._state.navigator, blind._state.navigator
    for name in ("C_nb", "rates", "u", "power"):
        assert np.array_equal(getattr(mine, name), getattr(other, name)), name
    assert np.array_equal(mine.episode.x, other.episode.x)
    assert [(e.time, e.kind, e.subject) for e in honest.events] == [(e.time, e.kind, e.subject) for e in blind.events]
    assert np.isnan(blind["protected.error.position.up"]).all(), "the scrambling reached the scoring, so it was real"


def test_given_a_fork_and_a_rewind_then_the_flight_goes_on_to_the_same_bits():
    alone = Simulation(scenario(pair(1), 1.6)).advance()
    sim = Simulation(scenario(pair(1), 1.6)).advance(until=1.3)
    assert same(sim.fork(at=0.98).advance(), alone)
    assert same(sim.rewind(to=1.02).advance(), alone)


def test_given_a_batch_then_run_k_is_what_it_is_alone():
    batch = Simulation(scenario(pair(1), 1.6), runs=4).advance()
    alone = Simulation(scenario(pair(1), 1.6), first_run=2).advance()
    # The loop is closed over an aircraft that is unstable by itself: rounding grows a little.
    np.testing.assert_allclose(
        batch.recording.rows[:, 2], alone.recording.rows[:, 0], rtol=1e-7, atol=1e-7, equal_nan=True
    )


def test_given_commands_then_the_document_replays_to_the_same_bits():
    sim = Simulation(scenario(duration=1.5)).advance(until=0.4)
    fault = sim.inject(Fault(channel="imu.gyro.2x", kind="noise", magnitude=0.2))
    sim.configure(driving_test="glt", lead=5)
    sim.advance(until=0.9)
    sim.switch("imu.gyro.3", False).clear(str(fault.id))
    sim.advance()
    replayed = Simulation(Scenario.model_validate(json.loads(sim.document().model_dump_json()))).advance()
    assert np.array_equal(replayed.recording.rows, sim.recording.rows, equal_nan=True)


@st.composite
def schedules(draw):
    faults = draw(
        st.lists(
            st.tuples(
                st.sampled_from(CHANNELS),
                st.sampled_from(sorted(KINDS)),
                st.floats(0.001, 1e4),
                st.integers(0, 30),
                st.none() | st.integers(1, 20),
            ),
            max_size=6,
        )
    )
    switches = draw(
        st.lists(st.tuples(st.integers(0, 30), st.sampled_from([*SUBJECTS, "air"]), st.booleans()), max_size=4)
    )
    driver = draw(st.sampled_from(["isolation-angle", "fault-plane", "glt", "optimal-parity", "none"]))
    return faults, switches, driver, draw(st.booleans())


def fly_schedule(schedule):
    faults, switches, driver, hybrid = schedule
    sim = Simulation(scenario(driving_test=driver, hybrid=hybrid), runs=2)
    for epoch in range(50):
        for channel, kind, magnitude, start, length in faults:
            if start == epoch:
                size = min(magnitude, largest(kind, UNITS[channel]) or magnitude)
                end = None if length is None else sim.now + 0.02 * length
                lay(sim, sized(channel, kind, size, end=end))
        for at, name, on in switches:
            if at == epoch:
                sim.switch(name, on)
        if epoch == 40 and faults:
            sim.clear_all()
        sim.step()
    return sim


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(schedules())
def test_given_any_schedule_then_nothing_crashes_nothing_is_nan_and_the_bits_repeat(schedule):
    sim = fly_schedule(schedule)
    for name, column in sim.recording.column.items():
        if not name.startswith("residual.ukf.") and not name.endswith(".statistic"):
            assert np.isfinite(sim.recording.rows[..., column]).all(), name
    assert same(sim, fly_schedule(schedule))


# ---- it says what it is


def test_every_declared_name_exists():
    signals = {s.name for s in DESCRIPTION.signals}
    sim = Simulation(scenario(pair(1), 1.2)).advance()
    assert list(sim.recording.column) == [s.name for s in DESCRIPTION.signals]
    assert sim.recording.rows.shape[-1] == len(signals)
    for chart in DESCRIPTION.charts:
        assert {t.signal for t in chart.traces} <= signals
    blocks = {b.id for b in DESCRIPTION.blocks}
    assert all({w.source, w.target} <= blocks for w in DESCRIPTION.wires)
    settings_of = set(DESCRIPTION.settings_schema["properties"])
    assert all(set(b.settings) <= settings_of for b in DESCRIPTION.blocks)
    for view in (sim.view(at=0.0), sim.view()):
        assert set(view.blocks) == blocks
        assert set(view.items) == {item.id for item in DESCRIPTION.scene}
    subjects = {(t.name, s) for t in DESCRIPTION.tests for s in t.subjects}
    assert subjects == set(sim._assembly.tests)


def test_the_view_tells_the_story_in_words():
    sim = Simulation(scenario(pair(1), 1.3)).advance()
    before, at, after = sim.view(at=0.5), sim.view(at=1.0), sim.view()
    assert before.blocks["ukf"].text == "rests"
    assert at.blocks["supervisor"].text == "doubts 1, 3"
    assert at.blocks["control"].text == "rates of the UKF"
    assert at.items["parity"].health == "suspect"
    assert after.blocks["supervisor"].text == "gyro 1 out"
    assert after.items["axis.1x"].health == "isolated"
    assert after.blocks["geometry"].text == "J_FDI 4.00, J_GNC 0.354"
    where = np.array(after.items["path.healthy"].vector)
    assert where[1] == pytest.approx(1.3 * 153.0 * 0.97 / 1000.0, rel=0.02)  # north, in km
    assert after.items["path.healthy"].vector != after.items["path.unprotected"].vector


@pytest.mark.parametrize("mounting", [(45.0, 45.0, 45.0), (30.0, 60.0, 10.0), (0.0, 0.0, 0.0)])
def test_given_other_mounting_angles_then_the_indices_answer_and_it_flies(mounting):
    from ftcore.detection import geometry

    sim = Simulation(scenario(duration=0.3, parameters={"gyros": {"mounting": mounting}})).advance()
    H = geometry.input_axes(*np.deg2rad(mounting))
    assert sim["geometry.fdi"][-1, 0] == pytest.approx(geometry.fdi_index(H))
    assert sim["geometry.gnc"][-1, 0] == pytest.approx(geometry.gnc_index(H))
    assert np.isfinite(sim["protected.distance"]).all()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"flight": {"legs": []}}, "legs"),
        ({"flight": {"legs": [{"bank": 70.0}], "speed": 350.0, "height": 10000.0}}, "cannot fly this"),
        ({"mismatch": {"mass": 1000.0}}, "mass"),
        ({"gyros": {"noise": 0.0}}, "noise"),
    ],
)
def test_given_parameters_that_cannot_be_then_they_are_refused_by_name(wrong, message):
    with pytest.raises(ValidationError, match=message):
        scenario(parameters=wrong)


# ---- the three aircraft


def test_given_no_fault_and_nobody_isolated_then_all_three_fly_the_same_bits():
    sim = Simulation(scenario(duration=1.0, driving_test="none"), runs=2).advance()
    for name in ("protected", "unprotected"):
        assert (sim[f"{name}.distance"] == 0.0).all()


def test_given_no_fdi_then_the_protected_aircraft_is_the_unprotected_one():
    sim = Simulation(scenario(pair(1, start=0.5), driving_test="none")).advance()
    assert sim["unprotected.distance"][-1, 0] > 0.5
    np.testing.assert_array_equal(sim["protected.distance"], sim["unprotected.distance"])


def test_given_any_fault_then_the_healthy_twin_does_not_notice():
    faults = [
        *pair(1, start=0.2),
        {"channel": "imu.gyro.3x", "kind": "dropout", "start": 0.5},
        {"channel": "air.alpha.value", "kind": "bias", "magnitude": 5.0, "start": 0.3},
    ]
    calm, broken = Simulation(scenario(duration=1.5)).advance(), Simulation(scenario(faults, 1.5)).advance()
    for part in ("east", "north", "up"):
        np.testing.assert_array_equal(calm[f"path.healthy.{part}"], broken[f"path.healthy.{part}"])
    assert (calm["path.unprotected.up"] != broken["path.unprotected.up"]).any()


def test_the_mission_is_flown():
    """Climb at 120 ft/s for 5 s, then a turn at 45 degrees."""
    sim = Simulation(scenario(duration=12.0)).advance()
    time, height = sim.time, sim["height.healthy"][:, 0]
    climbing = (time > 1.0) & (time < 4.9)
    assert np.polyfit(time[climbing], height[climbing], 1)[0] == pytest.approx(120 * 0.3048, rel=0.02)
    assert np.rad2deg(sim["truth.roll"][time < 4.9]).max() < 3.0
    late = time > 10.0
    assert np.rad2deg(sim["truth.roll"][late, 0]).mean() == pytest.approx(45.0, abs=1.0)
    assert np.ptp(height[late]) < 5.0
    turn = np.unwrap(sim["truth.heading"][late, 0])
    assert np.polyfit(time[late], turn, 1)[0] == pytest.approx(9.8 / 153.0, rel=0.2)
    assert abs(sim["truth.speed"][:, 0] - 153.0).max() < 3.0


def test_what_reaches_the_ground_stays_there():
    flight = {"height": 100.0, "legs": [{"duration": 1.0, "climb_rate": -40.0}]}
    sim = Simulation(scenario(pair(2, size=2.0, start=0.1), 9.0, parameters={"flight": flight}, driving_test="none"))
    height = sim.advance()["height.unprotected"][:, 0]
    down = np.flatnonzero(height <= 0.0)
    assert len(down)
    assert np.ptp(height[down]) == 0.0
    assert np.isfinite(sim.recording.rows[..., sim.recording.column["unprotected.distance"]]).all()


def test_what_breaks_up_stays_where_it_broke_and_the_flight_goes_on():
    """Schedule 16 of tests/papers/schedules.py, made worse: with a stuck gyro the equations overflowed."""
    stuck = [{"channel": f"imu.gyro.{axis}", "kind": "ramp", "magnitude": 20.0, "start": 0.5} for axis in ("1x", "2x")]
    sim = Simulation(scenario(stuck, 3.0, driving_test="none")).advance()
    assert np.isfinite(sim["unprotected.distance"]).all()
    assert max(np.abs(sim[f"truth.{a}"]).max() for a in ("alpha", "beta", "roll", "pitch")) < 100.0
    assert np.isfinite(sim["path.healthy.east"]).all()


# ---- detection and isolation


@pytest.mark.parametrize(
    ("gyro", "second", "twin"), [(1, 1, 3), (1, -1, 2), (2, 1, 3), (2, -1, 1), (3, 1, 2), (3, -1, 1)]
)
def test_given_a_fault_in_a_singular_direction_then_two_are_declared_and_the_ukf_names_the_right_one(
    gyro, second, twin
):
    sim = Simulation(scenario(pair(gyro, second), 1.2), runs=6).advance()
    assert set(isolated(sim)) == {(run, str(gyro)) for run in range(6)}
    assert max(isolated(sim).values()) <= 1.1
    after = sim.time >= 1.0
    for k in (1, 2, 3):
        share = sim[f"test.isolation-angle.imu.gyro.{k}.alarm"][after].mean()
        assert share > 0.9 if k in (gyro, twin) else share < 0.05
    third = ({1, 2, 3} - {gyro, twin}).pop()
    assert np.isnan(sim[f"test.ukf.imu.gyro.{third}.statistic"][51:]).mean() > 0.9
    assert sim[f"test.ukf.imu.gyro.{gyro}.alarm"][after].mean() > 0.97
    assert sim[f"test.ukf.imu.gyro.{twin}.alarm"][after].mean() < 0.1


@pytest.mark.parametrize("driver", ["isolation-angle", "fault-plane", "glt", "optimal-parity"])
def test_given_any_driving_test_then_the_fault_of_the_paper_is_isolated_and_nobody_else(driver):
    sim = Simulation(scenario(pair(1), 1.2, driving_test=driver), runs=4).advance()
    assert set(isolated(sim)) == {(run, "1") for run in range(4)}


def test_given_a_tie_then_glt_and_optimal_parity_vector_name_nobody():
    sim = Simulation(scenario(pair(1), 1.4), runs=4).advance()
    after = sim.time >= 1.0
    for test in ("glt", "optimal-parity"):
        for k in (1, 2, 3):
            assert sim[f"test.{test}.imu.gyro.{k}.alarm"][after].mean() < 0.05


def test_given_a_single_axis_fault_then_parity_space_is_enough():
    sim = Simulation(scenario([bias("2x", 0.15)], 1.1), runs=8).advance()
    assert set(isolated(sim)) == {(run, "2") for run in range(8)}
    named = {run: t for (run, _), t in isolated(sim).items()}
    asked = [e for e in sim.events if e.kind == "filter.started" and 1.0 <= e.time <= named[e.run]]
    assert len(asked) <= 1  # the parity vector is 0.106 long: noise turns it past T_i now and then
    for test in ("glt", "optimal-parity"):
        assert sim[f"test.{test}.imu.gyro.2.alarm"][sim.time >= 1.0].mean() > 0.8


def test_given_a_fault_that_ends_then_the_gyro_is_readmitted_and_the_ukf_rests():
    sim = Simulation(scenario(pair(1, end=1.5), 2.6), runs=3).advance()
    back = [e for e in sim.events if e.kind == "subsystem.readmitted"]
    assert {(e.run, e.subject) for e in back} == {(run, "imu.gyro.1") for run in range(3)}
    assert all(2.0 - 0.05 <= e.time < 2.4 for e in back)
    assert sim["used.imu.gyro.1"][-1].all()
    assert not sim["ukf.active"][-1].any()


def test_given_gyros_without_readings_then_the_ukf_flies_on():
    faults = [{"channel": f"imu.gyro.{axis}", "kind": "dropout", "start": t} for axis, t in (("1x", 0.5), ("3y", 1.0))]
    sim = Simulation(scenario(faults, 4.0), runs=2).advance()
    assert sim["control.by-ukf"][60:].all()
    assert sim["protected.distance"].max() < 10.0
    assert not isolated(sim)


def test_given_the_operator_switches_a_gyro_off_and_on_then_it_leaves_and_returns():
    sim = Simulation(scenario(duration=1.0)).advance(until=0.3)
    sim.switch("imu.gyro.2", False).advance(until=0.6)
    assert sim.subsystems["imu.gyro.2"].health == "off"
    assert not sim["used.imu.gyro.2"][-1, 0]
    sim.switch("imu.gyro.2", True).advance(until=0.7)
    assert sim["used.imu.gyro.2"][-1, 0]


def test_given_a_model_that_is_far_off_then_the_tie_is_said():
    far = {"mismatch": {"mass": 30.0, "centre_of_gravity": 20.0, "aerodynamics": 30.0}}
    sim = Simulation(scenario(pair(1, start=0.5), 0.9, parameters=far)).advance()
    assert "integrity.cannot-isolate" in {e.kind for e in sim.events}
    assert sim["isolation.ambiguous"].any()
    assert sim.view().blocks["ukf"].text == "cannot tell"
