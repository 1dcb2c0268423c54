"""The five ideas that hold the house together, on a flying system."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from ftcore import CommandError, Fault, Scenario, Simulation, catalogue
from ftcore.faults import KINDS, largest
from tests.faulting import lay, sized

VISIBLE = Scenario.load("zhang-1992-visible")
DESCRIPTION = catalogue.system("sins-gps-doppler")
CHANNELS = [c.name for c in DESCRIPTION.channels]
UNITS = {c.name: c.unit for c in DESCRIPTION.channels}


def same(a, b):
    """Bit for bit, NaN included."""
    return np.array_equal(a.recording.rows, b.recording.rows, equal_nan=True) and [
        e.model_dump() for e in a.events
    ] == [e.model_dump() for e in b.events]


@cache
def undisturbed(until=None):
    """A flight that nobody touches, for tests that only look at it."""
    return Simulation(VISIBLE).advance(until=until)


# ---- truth never reaches an estimator


def test_given_truth_is_scrambled_after_the_readings_then_no_estimate_and_no_decision_changes():
    honest, blind = Simulation(VISIBLE), Simulation(VISIBLE)
    plant = blind._assembly.plant
    step = plant.step

    def scrambled(state, epoch, command):
        after, truth, readings = step(state, epoch, command)
        wild = {name: np.full_like(getattr(truth, name), np.nan) for name in ("lla", "v_n", "C_nb", "rpy")}
        return after, replace(truth, **wild), readings

    blind._assembly = replace(blind._assembly, plant=type("Scrambled", (), {"step": staticmethod(scrambled)})())
    for _ in range(60):
        honest.step()
        blind.step()
    assert np.array_equal(honest._state.navigator.filters.x, blind._state.navigator.filters.x)
    assert np.array_equal(honest._state.navigator.filters.P, blind._state.navigator.filters.P)
    assert np.array_equal(honest._state.navigator.ins.lla, blind._state.navigator.ins.lla)
    assert [(e.time, e.kind, e.subject) for e in honest.events] == [(e.time, e.kind, e.subject) for e in blind.events]
    errors = [i for n, i in honest.recording.column.items() if ".error." in n]
    assert np.isnan(blind.recording.rows[..., errors]).all(), "the scrambling reached the scoring, so it was real"


# ---- state is a value


def test_given_a_fork_then_both_branches_fly_the_same_bits_if_nothing_is_done():
    sim = undisturbed()
    assert same(sim, sim.fork(at=37.0).advance())


def test_given_a_fork_when_one_branch_is_broken_then_the_other_does_not_notice():
    sim = Simulation(VISIBLE).advance(until=45.0)
    branch = sim.fork()
    branch.inject(Fault(channel="doppler.velocity.x", kind="bias", magnitude=5.0))
    branch.switch("altimeter", False).advance()
    assert same(sim.advance(), undisturbed())
    assert not same(branch, undisturbed())


@pytest.mark.parametrize("to", [0.0, 1.0, 33.0, 64.0, 99.0])
def test_given_a_rewind_then_the_flight_goes_on_to_the_same_bits(to):
    sim = Simulation(VISIBLE).advance()
    sim.rewind(to=to)
    assert sim.now == to
    assert sim.time.size == int(to)
    assert same(sim.advance(), undisturbed())


def test_given_a_rewind_then_later_commands_are_forgotten_and_earlier_ones_kept():
    sim = Simulation(VISIBLE).advance(until=20.0)
    sim.inject(Fault(channel="gps.pseudorange.A3", kind="bias", magnitude=50.0, start=80.0))
    sim.advance(until=40.0)
    sim.switch("doppler", False)
    sim.advance(until=60.0).rewind(to=30.0)
    assert sim.subsystems["doppler"].enabled
    assert [f.fault.channel for f in sim.faults][-1] == "gps.pseudorange.A3"
    assert all(e.time <= 30.0 for e in sim.events)


def test_given_a_step_then_no_published_state_is_changed_in_place():
    sim = Simulation(VISIBLE).advance(until=49.0)
    state = sim._state
    before = state.navigator.filters.x.copy(), state.navigator.filters.P.copy(), state.navigator.ins.lla.copy()
    sim.advance(until=55.0)
    after = state.navigator.filters.x, state.navigator.filters.P, state.navigator.ins.lla
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))


# ---- batch first


def test_given_a_batch_then_run_k_is_what_it_is_alone():
    batch = Simulation(VISIBLE, runs=6).advance()
    for k in (0, 4):
        alone = Simulation(VISIBLE, first_run=k).advance()
        np.testing.assert_allclose(
            batch.recording.rows[:, k], alone.recording.rows[:, 0], rtol=1e-9, atol=1e-9, equal_nan=True
        )


# ---- randomness is addressed


def test_given_a_fault_on_one_channel_then_no_other_channel_of_the_plant_moves():
    calm, broken = Simulation(VISIBLE), Simulation(VISIBLE)
    broken.inject(Fault(channel="altimeter.height.up", kind="noise", magnitude=5.0, start=0.0))
    for _ in range(20):
        calm.step()
        broken.step()
    for name in ("reading.doppler.x", "reading.doppler.z"):
        np.testing.assert_array_equal(calm[name], broken[name])
    np.testing.assert_array_equal(calm["parity.gyro.1"], broken["parity.gyro.1"])


# ---- same scenario + seed + commands = same bits


def operate(sim, stepper):
    """A busy operator; ``stepper`` is how time goes on."""
    stepper(sim, 10.0)
    fault = sim.inject(Fault(channel="gps.pseudorange.A3", kind="outliers", magnitude=200.0))
    stepper(sim, 22.0)
    sim.configure(driving_test="two-propagator", confirm=3, within=5)
    sim.switch("doppler", False)
    stepper(sim, 35.0)
    sim.change(str(fault.id), magnitude=50.0, end=60.0)
    sim.switch("doppler", True)
    stepper(sim, 70.0)
    sim.clear_all()
    stepper(sim, 100.0)
    return sim


def test_given_the_same_commands_then_stepped_advanced_watched_and_replayed_are_the_same_bits():
    def stepped(sim, until):
        while sim.now < until:
            sim.step()
            sim.view(), sim.latest(), sim.score()

    advanced = operate(Simulation(VISIBLE), lambda sim, until: sim.advance(until=until))
    watched = operate(Simulation(VISIBLE), stepped)
    assert same(advanced, watched)
    document = Scenario.model_validate(json.loads(advanced.document().model_dump_json()))
    replayed = Simulation(document).advance()
    assert np.array_equal(replayed.recording.rows, advanced.recording.rows, equal_nan=True)
    again = Simulation(replayed.document()).advance()
    assert np.array_equal(again.recording.rows, advanced.recording.rows, equal_nan=True)


def test_given_another_seed_then_the_noise_is_another():
    a, b = Simulation(VISIBLE, seed=1).advance(until=5.0), Simulation(VISIBLE, seed=2).advance(until=5.0)
    assert not np.array_equal(a["reading.doppler.x"], b["reading.doppler.x"])


# ---- any fault, on any channel, at any moment


@st.composite
def schedules(draw):
    faults = draw(
        st.lists(
            st.tuples(
                st.sampled_from(CHANNELS),
                st.sampled_from(sorted(KINDS)),
                st.floats(0.001, 1e4),
                st.integers(0, 25),
                st.none() | st.integers(1, 20),
            ),
            max_size=6,
        )
    )
    switches = draw(
        st.lists(
            st.tuples(st.integers(0, 25), st.sampled_from(["gps", "doppler", "altimeter"]), st.booleans()), max_size=4
        )
    )
    modes = draw(st.sampled_from(["fusion-reset", "no-reset", "zero-reset", "rescale"]))
    master = draw(st.sampled_from(["federated", "covariance-intersection", "tolerant"]))
    integrity = draw(st.sampled_from(["off", "snapshot", "innovation"]))
    driver = draw(st.sampled_from(["residual", "state", "two-propagator", "glr", "cusum", "none"]))
    return faults, switches, modes, master, driver, integrity


def fly_schedule(schedule):
    faults, switches, mode, master, driver, integrity = schedule
    sim = Simulation(VISIBLE, runs=2)
    sim.configure(driving_test=driver, satellite_integrity=integrity)
    for epoch in range(30):
        for channel, kind, magnitude, start, length in faults:
            if start == epoch:
                magnitude = min(magnitude, largest(kind, UNITS[channel]) or magnitude)
                end = None if length is None else sim.now + length
                lay(sim, sized(channel, kind, magnitude, end=end))
        for at, name, on in switches:
            if at == epoch:
                sim.switch(name, on)
        if epoch == 12:
            sim.configure(fusion_mode=mode, master=master)
        if epoch == 20 and faults:
            sim.clear_all()
        sim.step()
    return sim


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(schedules())
def test_given_any_schedule_then_nothing_crashes_nothing_is_nan_and_the_bits_repeat(schedule):
    sim = fly_schedule(schedule)
    allowed = ("discrepancy.", "reading.", "gps.hdop")
    for name, column in sim.recording.column.items():
        finite = np.isfinite(sim.recording.rows[..., column])
        stem, _, part = name.rpartition(".")
        if name.startswith("test.") and part in ("statistic", "threshold"):
            assert np.array_equal(finite, sim[f"{stem}.dof"] > 0), f"{name} is a number where there was one to judge"
        elif not name.startswith(allowed):
            assert finite.all(), name
    assert same(sim, fly_schedule(schedule))


# ---- commands that are refused change nothing


@pytest.mark.parametrize(
    ("command", "field"),
    [
        (lambda s: s.inject(Fault(channel="gps.pseudorange.Z9", kind="bias", magnitude=1.0)), "channel"),
        (lambda s: s.inject(Fault(channel="gps.pseudorange.C1", kind="bias")), "magnitude"),
        (lambda s: s.inject(Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=1.0, end=3.0)), "end"),
        (lambda s: s.inject(Fault(id="satellite", channel="gps.pseudorange.C1", kind="bias", magnitude=1.0)), "id"),
        (lambda s: s.clear("nobody"), "fault"),
        (lambda s: s.change("satellite", magnitude=0.0), "magnitude"),
        (lambda s: s.change("satellite", colour="red"), "colour"),
        (lambda s: s.switch("radar", False), "name"),
        (lambda s: s.configure(false_alarm_probability=2.0), "false_alarm_probability"),
        (lambda s: s.configure(gps_share=0.0), "gps_share"),
        (lambda s: s.configure(colour="red"), "colour"),
        (lambda s: s.configure(confirm=5, within=3), "settings"),
        (lambda s: s.rewind(to=50.0), "to"),
        (lambda s: s.rewind(to=float("nan")), "to"),
        (lambda s: s.fork(at=-1.0), "at"),
        (lambda s: s.advance(until=1.0), "until"),
        (lambda s: s.advance(until=20.0, epochs=3), "until"),
        (lambda s: s.view(at=99.0), "at"),
    ],
)
def test_given_a_bad_command_then_it_is_refused_by_field_and_changes_nothing(command, field):
    sim = Simulation(VISIBLE).advance(until=10.0)
    with pytest.raises(CommandError) as refused:
        command(sim)
    assert refused.value.field == field
    assert sim.document() == undisturbed(10.0).document()
    assert same(sim.advance(until=60.0), undisturbed(60.0))


@pytest.mark.parametrize(
    "wrong",
    [
        {"system": "submarine"},
        {"system": "sins-gps-doppler", "colour": "red"},
        {"system": "sins-gps-doppler", "duration": float("nan")},
        {"system": "sins-gps-doppler", "parameters": {"flight": {"speed": -1}}},
        {"system": "sins-gps-doppler", "settings": {"gps_share": 0}},
        {"system": "sins-gps-doppler", "subsystems": {"radar": True}},
        {"system": "sins-gps-doppler", "faults": [{"channel": "x.y.z", "kind": "bias", "magnitude": 1}]},
    ],
)
def test_given_a_wrong_scenario_then_it_is_refused(wrong):
    with pytest.raises(ValidationError):
        Scenario.model_validate(wrong)


def test_given_an_unknown_scenario_then_the_message_lists_the_ready_ones():
    with pytest.raises(FileNotFoundError, match="zhang-1992-visible"):
        Scenario.load("nothing")


# ---- recording


def test_given_a_bounded_recording_then_it_thins_the_older_half_and_says_so():
    sim = Simulation(VISIBLE.model_copy(update={"duration": 300.0}), max_epochs=64).advance()
    assert len(sim.time) <= 64
    assert sim.time[-1] == 300.0
    assert sim.resolution[0]["every"] > 1.0
    assert sim.resolution[-1]["until"] < 300.0
    full = Simulation(VISIBLE.model_copy(update={"duration": 300.0})).advance()
    keep = np.isin(full.time, sim.time)
    np.testing.assert_array_equal(full["fused.error.position.up"][keep], sim["fused.error.position.up"])


def test_given_an_export_then_it_reads_back_to_the_bit(tmp_path):
    import pyarrow.csv
    import pyarrow.parquet

    sim = Simulation(VISIBLE, runs=2).advance(until=8.0)
    sim.to_parquet(tmp_path / "a.parquet")
    sim.to_csv(tmp_path / "a.csv")
    for table in (pyarrow.parquet.read_table(tmp_path / "a.parquet"), pyarrow.csv.read_csv(tmp_path / "a.csv")):
        up = table["fused.error.position.up"].to_numpy().reshape(8, 2)
        np.testing.assert_array_equal(up, sim["fused.error.position.up"])


def test_given_decimation_then_every_signal_keeps_its_extremes():
    sim = undisturbed()
    names = ["fused.error.position.up", "test.residual.gps.statistic"]
    _, few = sim.columns(names, points=20)
    _, every = sim.columns(names)
    for name in names:
        assert few[name].min() == every[name].min()
        assert few[name].max() == every[name].max()
        assert len(few[name]) < len(every[name])


def test_every_declared_name_exists():
    signals = {s.name for s in DESCRIPTION.signals}
    for chart in DESCRIPTION.charts:
        assert set(chart.signals()) <= signals
    blocks = {b.id for b in DESCRIPTION.blocks}
    assert all({w.source, w.target} <= blocks for w in DESCRIPTION.wires)
    view = Simulation(VISIBLE).advance(until=3.0).view()
    assert set(view.blocks) == blocks
    assert set(view.items) == {item.id for item in DESCRIPTION.scene}
