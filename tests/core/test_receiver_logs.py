"""A log has epochs of its own: everything that is counted in epochs or seconds goes by the log's interval."""

from pathlib import Path

import numpy as np
import pytest

from ftcore import CommandError, Fault, Scenario, Simulation
from ftcore.sensors import rinex
from ftcore.systems.gps_receiver.forms import LONGEST_LOG, Log
from ftcore.systems.gps_receiver.logs import log_scenario
from ftcore.systems.gps_receiver.plant import LogPlant, held
from ftcore.systems.gps_receiver.satellites import SATELLITES
from tests.synthetic_log import ANTENNA, Files, files

EPOCHS, INTERVAL = 40, 30.0
SEEN = "G10"


@pytest.fixture(scope="module")
def made() -> Files:
    return files(EPOCHS, INTERVAL)


@pytest.fixture(scope="module")
def paths(made: Files, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    return kept(made, tmp_path_factory.mktemp("log"))


@pytest.fixture(scope="module")
def scenario(paths: tuple[str, str]) -> Scenario:
    return Scenario.model_validate(log_scenario(*paths))


def kept(made: Files, folder: Path) -> tuple[str, str]:
    (folder / "a.26o").write_bytes(made.observation)
    (folder / "a.26n").write_bytes(made.navigation)
    return str(folder / "a.26o"), str(folder / "a.26n")


def error(sim: Simulation, estimator: str) -> np.ndarray:
    """Distance from the truth (epochs, runs) [m]."""
    parts = [sim[f"{estimator}.error.position.{part}"] for part in ("east", "north", "up")]
    return np.sqrt(np.sum(np.square(parts), axis=0))


# ---- time


def test_given_a_log_of_30_s_then_epochs_time_and_duration_are_the_logs(scenario):
    sim = Simulation(scenario)
    assert (sim.period, sim.last_epoch, sim.duration) == (30.0, 40, 1200.0)
    sim.step()
    assert sim.now == 30.0
    sim.advance(until=100.0)
    assert (sim.now, sim.epoch) == (90.0, 3)
    sim.advance()
    assert sim.finished
    np.testing.assert_array_equal(sim.time, 30.0 * np.arange(1, 41))
    np.testing.assert_allclose(np.diff(sim["gps.time"][:, 0]), 30.0, atol=1e-6)
    assert sim.score().time == 1200.0


def test_given_a_log_without_a_fault_then_the_receiver_is_where_the_files_say(scenario):
    """Noise of 0.5 m; the orbits of the files were made by other code than the one that reads them."""
    sim = Simulation(scenario).advance()
    assert np.median(error(sim, "snapshot")) < 1.5
    assert np.median(error(sim, "combined")) < 1.5
    assert not any(event.kind == "subsystem.isolated" for event in sim.events)


@pytest.mark.parametrize(
    ("duration", "epochs", "lasts"), [(10.0, 1, 30.0), (300.0, 10, 300.0), (310.0, 10, 300.0), (1e5, 40, 1200.0)]
)
def test_given_a_shorter_or_longer_scenario_then_it_ends_with_it_or_with_the_log(scenario, duration, epochs, lasts):
    sim = Simulation(scenario.model_copy(update={"duration": duration}))
    assert (sim.last_epoch, sim.duration) == (epochs, lasts)


def test_given_a_simulated_flight_then_it_may_not_last_as_long_as_a_log(scenario):
    document = scenario.model_dump()
    assert Scenario.model_validate(document | {"duration": LONGEST_LOG}).duration == LONGEST_LOG
    with pytest.raises(ValueError, match="36001 s is too long here; at most 36000 s"):
        Scenario.model_validate({"system": "gps-receiver", "duration": 36001.0})


def test_given_a_rewind_a_fork_and_a_replay_then_the_bits_are_the_same(scenario):
    sim = Simulation(scenario).advance(until=300.0)
    sim.inject(Fault(channel=f"gps.pseudorange.{SEEN}", kind="noise", magnitude=40.0, start=400.0))
    sim.advance()
    whole = sim.recording.rows.copy()
    np.testing.assert_array_equal(Simulation(sim.document()).advance().recording.rows, whole)
    branch = sim.fork(at=750.0)
    assert (branch.epoch, branch.period, branch.duration) == (25, 30.0, 1200.0)
    np.testing.assert_array_equal(branch.advance().recording.rows, whole)
    np.testing.assert_array_equal(sim.rewind(to=690.0).advance().recording.rows, whole)
    assert sim.view(at=600.0).time == 600.0


def test_given_a_bounded_recording_then_its_resolution_is_told_in_the_logs_seconds(scenario):
    sim = Simulation(scenario, max_epochs=16).advance()
    assert {one["every"] % 30.0 for one in sim.resolution} == {0.0}
    assert len(sim.time) <= 16
    assert np.diff(sim.time).min() == 30.0


# ---- faults


def test_given_a_bias_then_it_lies_over_the_epochs_of_its_seconds(scenario):
    sim = Simulation(scenario)
    sim.inject(Fault(channel=f"gps.pseudorange.{SEEN}", kind="bias", magnitude=80.0, start=300.0, end=600.0))
    sim.advance()
    times = sim.time[error(sim, "unprotected")[:, 0] > 15.0]
    assert times.tolist() == [300.0 + 30.0 * k for k in range(10)]
    assert error(sim, "combined").max() < 10.0
    named = [(event.time, event.subject) for event in sim.events if event.kind == "subsystem.isolated"]
    assert [subject for _, subject in named] == [f"gps.{SEEN}"]
    (fault,) = sim.score().faults
    assert fault.time_to_isolate == named[0][0] - 300.0
    assert fault.time_to_isolate % 30.0 == 0.0


def faulty_reading(scenario, **fault):
    """(reading with the fault minus clean reading) of one satellite by epoch, and the clean ones; metres."""
    healthy, broken = Simulation(scenario), Simulation(scenario)
    broken.inject(Fault(channel=f"gps.pseudorange.{SEEN}", **fault))
    column = SATELLITES.index(SEEN)
    readings = []
    for sim in (healthy, broken):
        seen = []
        step = sim._assembly.navigator.step

        def watch(state, given, controls, step=step, seen=seen):
            seen.append(given["gps.pseudorange"].values[0, column])
            return step(state, given, controls)

        object.__setattr__(sim._assembly, "navigator", type("Watched", (), {"step": staticmethod(watch)})())
        sim.advance()
        readings.append(np.array(seen))
    return readings[1] - readings[0], readings[0]


def test_given_a_ramp_then_it_grows_by_the_second_and_not_by_the_epoch(scenario):
    added, _ = faulty_reading(scenario, kind="ramp", magnitude=0.5, start=300.0)
    np.testing.assert_allclose(added, 0.5 * np.clip(30.0 * np.arange(1, 41) - 300.0, 0.0, None), atol=1e-6)


def test_given_a_delay_of_less_than_an_epoch_then_the_reading_lies_between_the_last_two(scenario):
    added, clean = faulty_reading(scenario, kind="delay", magnitude=6.0, start=300.0)
    late = clean[10:] - 6.0 / 30.0 * np.diff(clean)[9:]
    np.testing.assert_allclose((clean + added)[10:], late, atol=1e-6)
    np.testing.assert_array_equal(added[:9], 0.0)


def test_given_a_random_walk_then_its_variance_grows_with_the_seconds(scenario):
    """A walk of 1 m/sqrt(s): over 200 seeds the spread at the end is sqrt(900) m, within 5 sigma of its estimate."""
    sim = Simulation(scenario.model_copy(update={"duration": 900.0}), runs=200)
    sim.inject(Fault(channel=f"gps.pseudorange.{SEEN}", kind="random-walk", magnitude=1.0, start=0.0))
    sim.advance()
    walked = sim._state.memory.wandered["f1"][:, 0]
    assert walked.std() == pytest.approx(30.0, rel=5.0 / np.sqrt(400.0))


# ---- gaps


def test_given_gaps_then_the_reading_behind_them_is_the_last_one_and_not_valid(made):
    log = rinex.parse(made.observation, made.navigation)
    gappy = log.pseudorange.copy()
    gappy[12:15, 9] = np.nan
    log = type(log)(**{**log.__dict__, "pseudorange": gappy})
    plant = LogPlant(log, Log(observation="o", navigation="n"), 1)
    column = SATELLITES.index(SEEN)
    for epoch in (13, 14, 15):
        _, _, readings = plant.step(plant.initial(), epoch, None)
        group = readings["gps.pseudorange"]
        assert not group.valid[0, column]
        assert group.values[0, column] == log.pseudorange[11, 9]
        assert group.values[0, SATELLITES.index("G01")] == 0.0


def test_a_gap_at_the_start_reads_as_what_follows():
    values = np.array([[np.nan, np.nan], [5.0, np.nan], [np.nan, np.nan], [7.0, np.nan]])
    np.testing.assert_array_equal(held(values), [[5.0, 0.0], [5.0, 0.0], [5.0, 0.0], [7.0, 0.0]])


def test_given_ephemerides_said_twice_then_no_satellite_is_lost(made):
    head, body = made.navigation.split(b"END OF HEADER\n")
    twice = rinex.parse(made.observation, head + b"END OF HEADER\n" + body + body)
    np.testing.assert_array_equal(twice.pseudorange, rinex.parse(made.observation, made.navigation).pseudorange)


@pytest.mark.parametrize("interval", [1.0, 30.0])
@pytest.mark.parametrize("steps", [1, -3])
def test_given_a_receiver_that_sets_its_clock_then_nobody_notices(tmp_path, interval, steps):
    """The time tags stay, so the satellites are taken a few metres on: a millisecond of their motion."""
    steady, stepped = files(EPOCHS, interval), files(EPOCHS, interval, steps=steps)
    one, two = (rinex.parse(log.observation, log.navigation) for log in (steady, stepped))
    np.testing.assert_allclose(two.pseudorange, one.pseudorange, atol=2e-3)
    assert np.nanmax(np.linalg.norm(two.satellites - one.satellites, axis=-1)) < 4.0 * abs(steps)
    sim = Simulation(Scenario.model_validate(log_scenario(*kept(stepped, tmp_path)))).advance()
    assert error(sim, "combined").max() < 10.0
    assert not [event for event in sim.events if event.kind in ("filter.reset", "subsystem.isolated")]


# ---- what is wrong says where


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"observation": "nowhere"}, "parameters.log.observation"),
        ({"navigation": "nowhere"}, "parameters.log.navigation"),
        ({"antenna": [1.0, 2.0, 3.0]}, "parameters.log.antenna"),
    ],
)
def test_given_a_scenario_with_a_bad_log_then_the_error_names_its_place(scenario, change, field):
    log = scenario.parameters["log"] | change
    with pytest.raises(CommandError) as refused:
        Simulation(scenario.model_copy(update={"parameters": {"log": log}}))
    assert refused.value.field == field


def test_given_files_of_different_days_then_neither_alone_is_at_fault(made):
    other = files(EPOCHS, INTERVAL, days=3)
    with pytest.raises(rinex.LogError, match="do not belong together") as refused:
        rinex.parse(made.observation, other.navigation)
    assert refused.value.part is None


def test_given_a_header_without_position_then_the_antenna_is_asked_for_and_taken(tmp_path):
    paths = kept(files(EPOCHS, INTERVAL, position=False), tmp_path)
    with pytest.raises(rinex.LogError) as refused:
        log_scenario(*paths)
    assert refused.value.part == "antenna"
    sim = Simulation(Scenario.model_validate(log_scenario(*paths, tuple(ANTENNA)))).advance()
    assert np.median(error(sim, "snapshot")) < 1.5
