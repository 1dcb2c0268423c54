"""The GPS receiver as a system: the house's five ideas, the known facts, honesty with too few satellites, and time."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.stats import binom, chi2

from ftcore import CommandError, Fault, Scenario, Simulation, catalogue
from ftcore.detection.raim import CANNOT_DETECT, CANNOT_ISOLATE, CONSISTENT, EXCLUDED, NO_FIX
from ftcore.faults import KINDS, largest
from ftcore.systems.gps_receiver.estimators import ESTIMATORS
from ftcore.systems.gps_receiver.satellites import SLOTS
from tests.faulting import lay, sized

DESCRIPTION = catalogue.system("gps-receiver")
CHEY = Scenario.load("chey-2004")
QUIET = CHEY.model_copy(update={"faults": (), "settings": {}})
VISIBLE = ("A2", "A4", "B1", "C2", "C3", "D3", "F3", "F4")
READY = [s.id for s in catalogue.scenarios() if s.system == "gps-receiver"]


def same(a, b):
    """Bit for bit, NaN included."""
    return np.array_equal(a.recording.rows, b.recording.rows, equal_nan=True) and [
        e.model_dump() for e in a.events
    ] == [e.model_dump() for e in b.events]


def flown(*faults, runs=1, duration=100.0, **chosen):
    """A flight with these faults from the start of the scenario."""
    update = {"faults": faults, "settings": chosen, "duration": duration}
    return Simulation(CHEY.model_copy(update=update), runs=runs).advance()


def lost(*names, start, end=None):
    return [Fault(channel=f"gps.pseudorange.{n}", kind="dropout", start=start, end=end) for n in names]


def bias(name, size, start, end=None):
    return Fault(channel=f"gps.pseudorange.{name}", kind="bias", magnitude=size, start=start, end=end)


# ---- the house's ideas


def test_given_truth_is_scrambled_after_the_readings_then_no_estimate_and_no_decision_changes():
    honest, blind = Simulation(CHEY), Simulation(CHEY)
    plant = blind._assembly.plant

    def scrambled(state, epoch, command):
        after, truth, readings = plant.step(state, epoch, command)
        return after, replace(truth, position_e=truth.position_e * np.nan, C_en=truth.C_en * np.nan), readings

    blind._assembly = replace(blind._assembly, plant=type("Scrambled", (), {"step": staticmethod(scrambled)})())
    for _ in range(75):
        honest.step()
        blind.step()
    a, b = honest._state.navigator, blind._state.navigator
    assert np.array_equal(a.bank.x, b.bank.x)
    assert np.array_equal(a.place.position_e, b.place.position_e)
    assert [(e.time, e.kind, e.subject) for e in honest.events] == [(e.time, e.kind, e.subject) for e in blind.events]
    errors = [i for n, i in honest.recording.column.items() if ".error." in n]
    assert np.isnan(blind.recording.rows[..., errors]).all(), "the scrambling reached the scoring, so it was real"


@pytest.mark.parametrize("to", [0.0, 1.0, 45.0, 66.0])
def test_given_a_rewind_or_a_fork_then_the_flight_goes_on_to_the_same_bits(to):
    alone, sim = Simulation(CHEY).advance(), Simulation(CHEY).advance()
    branch = sim.fork(at=to)
    assert same(sim.rewind(to=to).advance(), alone)
    assert same(branch.advance(), alone)


def test_given_a_step_then_no_published_state_is_changed_in_place():
    sim = Simulation(CHEY).advance(until=65.0)
    state = sim._state.navigator
    arrays = state.bank.x, state.bank.P, state.place.position_e, state.waited, state.disagreed
    before = [a.copy() for a in arrays]
    sim.advance(until=85.0)
    assert all(np.array_equal(a, b) for a, b in zip(before, arrays, strict=True))


def test_given_a_batch_then_run_k_is_what_it_is_alone():
    batch = Simulation(CHEY, runs=5).advance()
    for k in (0, 3):
        alone = Simulation(CHEY, first_run=k).advance()
        np.testing.assert_allclose(
            batch.recording.rows[:, k], alone.recording.rows[:, 0], rtol=1e-9, atol=1e-7, equal_nan=True
        )


def test_given_a_document_then_it_replays_to_the_same_bits():
    sim = Simulation(CHEY)
    sim.advance(until=20.0).inject(bias("C2", 80.0, None))
    sim.configure(combination="or", alert_limit=40.0)
    sim.advance(until=50.0).clear_all()
    sim.switch("gps", False)
    sim.advance(until=55.0).switch("gps", True)
    sim.advance()
    assert same(Simulation(sim.document()).advance(), sim) or np.array_equal(
        Simulation(sim.document()).advance().recording.rows, sim.recording.rows, equal_nan=True
    )


@st.composite
def schedules(draw):
    channels = st.sampled_from([f"gps.pseudorange.{n}" for n in (*VISIBLE, "E1", "all")])
    fault = st.tuples(
        channels,
        st.sampled_from(sorted(KINDS)),
        st.floats(0.01, 1e9),
        st.integers(0, 20),
        st.none() | st.integers(1, 15),
    )
    modes = st.sampled_from(["sequential", "or", "and"])
    return draw(st.lists(fault, max_size=7)), draw(modes), draw(st.sampled_from([1.0, 1e-3])), draw(st.booleans())


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(schedules())
def test_given_any_schedule_then_nothing_crashes_and_what_must_be_a_number_is_one(schedule):
    faults, mode, p_wrong, outage = schedule
    sim = Simulation(QUIET, runs=2)
    sim.configure(combination=mode, wrong_isolation_probability=p_wrong)
    for epoch in range(26):
        for channel, kind, magnitude, start, length in faults:
            if start == epoch:
                size = min(magnitude, largest(kind, "m") or magnitude)
                lay(sim, sized(channel, kind, size, end=None if length is None else sim.now + length))
        if outage and epoch in (8, 12):
            sim.switch("gps", epoch == 12)
        sim.step()
    for name in ("status", "satellites", "stanford"):
        for estimator in ESTIMATORS:
            assert np.isfinite(sim[f"{estimator}.{name}"]).all()
    started = sim["combined.status"] != NO_FIX
    for estimator in ("filter", "combined", "unprotected"):
        assert np.isfinite(sim[f"{estimator}.error.position.horizontal"][started]).all()
    assert np.isin(sim["combined.stanford"], (0.0, 1.0, 2.0, 3.0)).all()
    sim.view()


# ---- what systems.md knows


def test_given_seoul_then_the_geometry_is_as_known():
    sim = Simulation(QUIET).advance(until=2.0)
    assert sim["gps.satellites"][0, 0] == 8
    assert sim["gps.dof"][0, 0] == 4
    assert sim["test.snapshot.gps.threshold"][0, 0] == pytest.approx(18.47, abs=0.005)
    assert sim["gps.hdop"][0, 0] == pytest.approx(0.98, abs=0.005)
    assert sim["protection.slope"][0, 0] == pytest.approx(54.0, abs=1.0)
    assert sim["protection.horizontal"][0, 0] == sim["protection.slope"][0, 0]
    detectable = [sim[f"detectable.{n}"][0, 0] for n in VISIBLE]
    assert min(detectable) == pytest.approx(85.0, abs=0.5)
    assert max(detectable) == pytest.approx(124.0, abs=0.5)
    assert np.isnan([sim[f"detectable.{n}"][0, 0] for n in SLOTS if n not in VISIBLE]).all()


def test_given_the_parity_twin_then_it_says_the_same_to_1e_9():
    sim = Simulation(CHEY, runs=10).advance()
    np.testing.assert_allclose(sim["test.parity.gps.statistic"], sim["test.snapshot.gps.statistic"], rtol=1e-9)
    np.testing.assert_array_equal(sim["test.parity.gps.alarm"], sim["test.snapshot.gps.alarm"])


def test_given_no_fault_then_alarms_errors_and_sigmas_are_what_theory_says():
    """Binomial band at 1e-6; the filter's prior is an hour's worth of seconds old, so 20 s are left to settle."""
    sim = Simulation(QUIET, runs=100).advance()
    trials = 100 * 100
    assert sim["test.snapshot.gps.alarm"].sum() <= binom.isf(1e-6, trials, 1e-3)
    assert sim["test.innovation.gps.alarm"][20:].sum() <= binom.isf(1e-6, 80 * 100, 1e-3)
    q = sim["test.snapshot.gps.statistic"].sum()
    assert chi2.ppf(1e-6, 4 * trials) < q < chi2.isf(1e-6, 4 * trials)
    for part in ("east", "north", "up"):
        ratio = sim[f"snapshot.error.position.{part}"] / sim[f"snapshot.sigma.position.{part}"]
        assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.05)
        # The filter allows for a receiver that moves: it is cautious for one that stands.
        ratio = sim[f"combined.error.position.{part}"][20:] / sim[f"combined.sigma.position.{part}"][20:]
        assert 0.6 < np.sqrt(np.mean(ratio**2)) < 1.05
    assert (sim["combined.stanford"] == 0.0).mean() > 0.99
    assert not (sim["combined.stanford"] == 2.0).any()


# ---- one fault, two faults, too few satellites


@pytest.mark.parametrize("name", VISIBLE)
def test_given_a_jump_of_300_m_then_its_satellite_is_out_at_once_and_back_soon_after(name):
    sim = flown(bias(name, 300.0, 30.0, 60.0), runs=4)
    used = sim[f"used.gps.{name}"]
    assert (used[:29] == 1.0).mean() > 0.97
    assert (used[29:59] == 0.0).all()
    assert (used[65:] == 1.0).mean() > 0.97
    assert np.abs(sim["combined.error.position.horizontal"][20:]).max() < 40.0
    assert {e.subject for e in sim.events if e.kind == "subsystem.isolated"} == {f"gps.{name}"}
    score = sim.score().faults[0]
    assert score.time_to_isolate == 1.0
    assert score.wrong_isolations == []
    assert score.time_to_readmit is not None


def test_given_two_faults_then_both_are_out_and_nobody_else():
    sim = Simulation(Scenario.load("raim-two-faults"), runs=20).advance()
    for name, onset in (("C2", 30), ("F4", 45)):
        assert (sim[f"used.gps.{name}"][onset:79] == 0.0).all()
    wrong = {e.subject for e in sim.events if e.kind == "subsystem.isolated"} - {"gps.C2", "gps.F4"}
    assert not wrong
    assert sim["combined.error.position.horizontal"][31:79].mean() < 12.0


def test_given_five_satellites_then_the_snapshot_says_cannot_isolate_and_four_cannot_detect():
    sim = Simulation(Scenario.load("raim-too-few"), runs=10).advance()
    status = sim["snapshot.status"]
    assert (status[20:29] == EXCLUDED).mean() > 0.97
    assert (status[29:59] == CANNOT_ISOLATE).all()
    assert (status[59:79] == CANNOT_DETECT).all()
    assert not sim["test.snapshot.gps.C2.alarm"][29:79].any(), "nobody is accused"
    assert (sim["snapshot.stanford"][29:79] == 3.0).all()
    assert np.isnan(sim["protection.horizontal"][59:79]).all()
    assert (sim["combined.status"][29:79] >= CANNOT_ISOLATE).all(), "the other four do not check each other"
    assert (sim["used.gps.C2"][29:79] == 0.0).all(), "but who was known to be wrong stays out"
    kinds = [e.kind for e in sim.events if e.run == 0 and e.kind.startswith("integrity.")]
    assert kinds[0] == "integrity.cannot-detect"
    assert "integrity.restored" in kinds


def test_given_a_fault_that_begins_with_five_satellites_then_nobody_is_accused():
    sim = flown(*lost("A4", "D3", "A2", start=10.0), bias("C2", 300.0, 20.0), runs=10, duration=40.0)
    assert (sim["snapshot.status"][20:] == CANNOT_ISOLATE).all()
    assert not sim["test.snapshot.gps.C2.alarm"].any()
    assert "integrity.cannot-isolate" in {e.kind for e in sim.events} or (sim["combined.status"][20:] >= 2).all()


def test_given_three_satellites_then_there_is_no_fix_and_the_filters_go_on():
    sim = flown(*lost("A4", "D3", "A2", "B1", "C2", start=30.0, end=40.0), duration=60.0)
    assert (sim["snapshot.status"][29:39] == NO_FIX).all()
    assert np.isnan(sim["snapshot.error.position.east"][29:39]).all()
    assert np.isfinite(sim["combined.error.position.east"][20:]).all()
    assert (sim["combined.stanford"][29:39] == 3.0).all()
    assert sim["combined.status"][-1, 0] == CONSISTENT


def test_given_gps_off_from_the_start_then_it_starts_when_it_is_switched_on():
    sim = Simulation(QUIET)
    sim.switch("gps", False)
    sim.advance(until=10.0)
    assert (sim["combined.status"] == NO_FIX).all()
    sim.view()
    sim.switch("gps", True)
    sim.advance(until=40.0)
    assert sim["combined.error.position.horizontal"][-1, 0] < 30.0
    assert sim["combined.status"][-1, 0] == CONSISTENT


# ---- the combination


def test_given_a_jump_common_to_all_then_the_combined_filter_restarts_and_the_position_does_not_move():
    sim = flown(Fault(channel="gps.pseudorange.all", kind="bias", magnitude=3000.0, start=50.0), runs=5)
    resets = [e for e in sim.events if e.kind == "filter.reset"]
    assert {e.run for e in resets} == set(range(5))
    assert {e.time for e in resets} == {51.0}
    assert not any(e.kind == "subsystem.isolated" for e in sim.events)
    assert not sim["test.snapshot.gps.alarm"][49:60].any(), "no satellite disagrees with another"
    assert sim["combined.error.position.horizontal"][50:].max() < 40.0
    assert sim["test.agreement.gps.alarm"][49].all()


@pytest.mark.parametrize(("mode", "out"), [("sequential", True), ("or", True), ("and", False)])
def test_given_a_fault_that_only_the_innovations_see_then_the_modes_differ(mode, out):
    """55 m on B1 is half of what a snapshot is sure to find, and enough for a filter that knows where it is."""
    sim = flown(bias("B1", 55.0, 40.0, 50.0), runs=60, duration=50.0, combination=mode)
    seen = sim["test.innovation.gps.B1.alarm"][39:42].any(axis=0)
    blind = ~sim["test.snapshot.gps.alarm"][39:42].any(axis=0)
    some = seen & blind
    assert some.sum() >= 5
    used = sim["used.gps.B1"][39:42][:, some]
    assert (used == 0.0).any(axis=0).all() == out
    if mode == "and":
        assert (used == 1.0).all()


def test_given_a_satellite_rejected_on_a_wrong_reference_then_it_is_not_rejected_for_ever():
    """A drift on D3 spoils the filter; after it has gone, every healthy satellite is back within 30 s."""
    sim = Simulation(CHEY.model_copy(update={"duration": 130.0}), runs=20).advance()
    for name in VISIBLE:
        assert (sim[f"used.gps.{name}"][110:] == 1.0).mean() > 0.98
    assert (sim["filter.satellites"][110:] == 8).mean() > 0.98


@pytest.mark.parametrize(
    ("chosen", "field"),
    [
        ({"combination": "both"}, "combination"),
        ({"alert_limit": 0.0}, "alert_limit"),
        ({"false_alarm_probability": 0.0}, "false_alarm_probability"),
        ({"confirm": 4, "within": 2}, "settings"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_given_a_bad_setting_then_it_is_refused_by_field(chosen, field):
    sim = Simulation(QUIET)
    with pytest.raises(CommandError) as refused:
        sim.configure(**chosen)
    assert refused.value.field == field


def test_given_the_alert_limit_then_availability_follows_it():
    sim = flown(runs=3, duration=30.0, alert_limit=50.0)
    assert (sim["snapshot.stanford"] == 3.0).all(), "the protection level is 54 m"
    sim.configure(alert_limit=60.0)
    wider = flown(runs=3, duration=30.0, alert_limit=60.0)
    assert (wider["snapshot.stanford"] == 0.0).mean() > 0.98


def test_given_protection_by_separation_then_the_chosen_level_is_that_one():
    sim = flown(duration=10.0, protection="separation")
    np.testing.assert_array_equal(sim["protection.horizontal"], sim["protection.separation"])
    assert (sim["protection.separation"] != sim["protection.slope"]).all()


# ---- self-description


def test_every_declared_name_exists():
    signals = {s.name for s in DESCRIPTION.signals}
    assert len(signals) == len(DESCRIPTION.signals)
    for chart in DESCRIPTION.charts:
        assert set(chart.signals()) <= signals
    blocks = {b.id for b in DESCRIPTION.blocks}
    assert all({w.source, w.target} <= blocks for w in DESCRIPTION.wires)
    known = DESCRIPTION.settings_schema["properties"]
    assert all(name in known for block in DESCRIPTION.blocks for name in block.settings)
    channels = {c.name for c in DESCRIPTION.channels}
    assert all(item.channel in channels for item in DESCRIPTION.scene)
    pictured = {trace.item for chart in DESCRIPTION.charts for trace in chart.traces if trace.item}
    assert pictured == {item.id for item in DESCRIPTION.scene}
    for until in (0.0, 3.0, 70.0):
        view = Simulation(CHEY).advance(until=until).view()
        assert set(view.blocks) == blocks
        assert set(view.items) == {item.id for item in DESCRIPTION.scene}
    assert set(DESCRIPTION.score_headline) <= signals
    for test in DESCRIPTION.tests:
        assert all(f"test.{test.name}.{subject}.alarm" in signals for subject in test.subjects)


def test_given_a_fault_then_the_scene_shows_the_satellite_red_and_the_excluded_one_grey():
    sim = Simulation(Scenario.load("chey-2004-step"))
    sim.inject(bias("A2", 5.0, 20.0))
    sim.advance(until=40.0)
    view = sim.view()
    assert view.items["satellite.A2"].health == "faulted"
    assert view.items["satellite.D3"].health == "isolated"
    assert view.items["satellite.C2"].health == "ok"
    assert sum(item.visible for item in view.items.values()) == 8
    assert view.blocks["satellites"].health == "faulted"
    assert view.blocks["combination"].health == "isolated"
    assert "D3" in view.blocks["combination"].text
    up = np.array(view.items["satellite.C2"].vector)
    assert np.degrees(np.arcsin(up[2] / np.linalg.norm(up))) == pytest.approx(68.7, abs=0.5)


@pytest.mark.parametrize("name", READY)
def test_every_ready_scenario_flies_and_scores(name):
    sim = Simulation(Scenario.load(name)).advance()
    assert sim.finished
    assert sim.score().headline
