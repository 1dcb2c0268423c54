"""SINS/GPS/BD2/CNS: the house's five ideas, Yang 2016's algorithm, and what its parts do to each other."""

import json
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import chi2

from ftcore import CommandError, Fault, Scenario, Simulation, catalogue
from ftcore.faults import KINDS
from ftcore.systems.sins_gps_bd2_cns.aids import AIDS
from ftcore.systems.sins_gps_bd2_cns.estimators import ESTIMATORS
from ftcore.systems.sins_gps_bd2_cns.weights import SUBSETS

DESCRIPTION = catalogue.system("sins-gps-bd2-cns")
ARCSEC = np.pi / 180.0 / 3600.0
HARD = {"channel": "gps.position.all", "kind": "bias", "magnitude": 60.0, "start": 20.0, "end": 50.0}
CALM = {"inertial": {"scale_factor": 0.0}}


def scenario(faults=(), duration=70.0, seed=2, parameters=None, **settings):
    return Scenario.model_validate(
        {
            "system": "sins-gps-bd2-cns",
            "duration": duration,
            "seed": seed,
            "faults": list(faults),
            "parameters": parameters or {},
            "settings": settings,
        }
    )


def same(a, b):
    return np.array_equal(a.recording.rows, b.recording.rows, equal_nan=True) and [
        e.model_dump() for e in a.events
    ] == [e.model_dump() for e in b.events]


def at(sim, signal, time):
    return sim[signal][np.searchsorted(sim.time, time - 1e-9)]


# ---- the house's ideas


def test_given_truth_is_scrambled_after_the_readings_then_no_estimate_and_no_decision_changes():
    honest, blind = Simulation(scenario([HARD])), Simulation(scenario([HARD]))
    step = blind._assembly.plant.step

    def scrambled(state, epoch, command):
        after, truth, readings = step(state, epoch, command)
        wild = {name: np.full_like(getattr(truth, name), np.nan) for name in ("lla", "v_n", "C_nb", "rpy")}
        return after, replace(truth, **wild), readings

    blind._assembly = replace(blind._assembly, plant=type("Scrambled", (), {"step": staticmethod(scrambled)})())
    honest.advance()
    with np.errstate(invalid="ignore"):
        blind.advance()
    mine, other = honest._state.navigator, blind._state.navigator
    for a, b in ((mine.protected.main, other.protected.main), (mine.conventional, other.conventional)):
        assert np.array_equal(a.mixture.x, b.mixture.x)
        assert np.array_equal(a.pair.P, b.pair.P)
    assert np.array_equal(mine.ins.lla, other.ins.lla)
    assert [(e.time, e.kind, e.subject) for e in honest.events] == [(e.time, e.kind, e.subject) for e in blind.events]
    assert np.isnan(blind["fused.error.position.up"]).all(), "the scrambling reached the scoring, so it was real"


@pytest.mark.parametrize("master", ["tolerant", "federated"])
def test_given_a_fork_and_a_rewind_then_the_flight_goes_on_to_the_same_bits(master):
    alone = Simulation(scenario([HARD], master=master)).advance()
    sim = Simulation(scenario([HARD], master=master)).advance(until=65.0)
    assert same(sim.fork(at=33.0).advance(), alone)
    assert same(sim.rewind(to=59.0).advance(), alone)


def test_given_a_batch_then_run_k_is_what_it_is_alone():
    batch = Simulation(scenario([HARD]), runs=4).advance()
    alone = Simulation(scenario([HARD]), first_run=2).advance()
    np.testing.assert_allclose(
        batch.recording.rows[:, 2], alone.recording.rows[:, 0], rtol=1e-7, atol=1e-9, equal_nan=True
    )


def test_given_commands_then_the_document_replays_to_the_same_bits():
    sim = Simulation(scenario()).advance(until=12.0)
    fault = sim.inject(Fault(channel="cns.attitude.roll", kind="noise", magnitude=30.0))
    sim.configure(driving_test="two-propagator-state", feedback_period=10)
    sim.advance(until=25.0)
    sim.switch("bd2", False).clear(str(fault.id))
    sim.configure(master="federated", fusion_mode="no-reset").copy()
    sim.advance(until=40.0)
    sim.switch("bd2", True)
    sim.configure(master="tolerant", mode_driver="held", exclusion="isolation", recovery="both")
    sim.advance()
    replayed = Simulation(Scenario.model_validate(json.loads(sim.document().model_dump_json()))).advance()
    assert np.array_equal(replayed.recording.rows, sim.recording.rows, equal_nan=True)


@pytest.mark.parametrize("configuration", ["three-axis", "redundant"])
def test_every_kind_of_fault_goes_on_every_channel_and_every_number_stays_a_number(configuration):
    """All kinds on all channels, four at a time, two epochs each: estimates and decisions stay finite."""
    sizes = {"delay": 2.0, "scale-factor": 0.1}
    parameters = {"inertial": {"configuration": configuration}}
    absent = Simulation(scenario(duration=10.0, parameters=parameters)).unavailable
    pairs = [(c, kind) for c in DESCRIPTION.channels for kind in KINDS if c.name not in absent]
    assert all(set(c.kinds) == set(KINDS) for c in DESCRIPTION.channels)
    faults = [
        {
            "channel": c.name,
            "kind": kind,
            "magnitude": 0.0 if kind in ("stuck", "dropout") else sizes.get(kind, 3.0 * c.typical),
            "start": 5.0 + (i // 4),
            "end": 6.5 + (i // 4),
        }
        for i, (c, kind) in enumerate(pairs)
    ]
    for part in range(0, len(faults), 160):
        chosen = [f | {"start": f["start"] - part // 4, "end": f["end"] - part // 4} for f in faults[part : part + 160]]
        sim = Simulation(scenario(chosen, duration=50.0, parameters=parameters)).advance()
        for name in ("error", "sigma", "nees", "weight", "probability", "validity"):
            columns = [i for n, i in sim.recording.column.items() if name in n.split(".")]
            assert np.isfinite(sim.recording.rows[..., columns]).all(), (name, part)


def test_given_the_imu_of_three_axes_then_the_test_that_drives_the_redundant_one_is_refused_with_the_reason():
    plain = Simulation(scenario(duration=10.0))
    with pytest.raises(CommandError, match="changes nothing here: three axes do not check each other") as refused:
        plain.configure(imu_driving_test="parity")
    assert refused.value.field == "imu_driving_test"
    plain.configure(imu_driving_test="glt", confirm=2)  # as it is already
    redundant = Simulation(scenario(duration=10.0, parameters={"inertial": {"configuration": "redundant"}}))
    assert redundant.configure(imu_driving_test="parity")["imu_driving_test"] == "parity"


def test_a_refused_command_changes_nothing_and_says_what_would_be_right():
    sim = Simulation(scenario(duration=10.0)).advance(until=3.0)
    before = sim.settings
    with pytest.raises(CommandError, match="doubt begins before rejection"):
        sim.configure(doubt_probability=0.001)
    with pytest.raises(CommandError, match="gps\\.position"):
        sim.inject(Fault(channel="gps.position.west", kind="bias", magnitude=1.0))
    with pytest.raises(ValidationError):
        scenario(parameters={"models": {"ratio": 0.1}})
    assert sim.settings == before
    assert not sim.faults


def test_what_is_recorded_is_what_is_described():
    sim = Simulation(scenario(duration=5.0), runs=2).advance()
    assert sim.recording.rows.shape == (5, 2, len(DESCRIPTION.signals))
    named = {t.signal for c in DESCRIPTION.charts for t in c.traces}
    named |= {t.sigma for c in DESCRIPTION.charts for t in c.traces if t.sigma}
    assert named <= set(sim.signals)
    view = sim.view()
    assert set(view.blocks) == {b.id for b in DESCRIPTION.blocks}
    assert set(view.items) == {i.id for i in DESCRIPTION.scene}
    seen = [i for i, item in view.items.items() if i.startswith("satellite.") and item.visible]
    assert sum("gps" in i for i in seen) >= 4
    assert sum("bd2" in i for i in seen) >= 6
    assert {s for b in DESCRIPTION.blocks for s in b.settings} <= set(sim.settings)
    assert set(DESCRIPTION.estimators) == set(ESTIMATORS)


# ---- the mechanics of Yang 2016


def test_the_reference_is_never_a_propagator_that_was_just_reset():
    sim = Simulation(scenario(duration=200.0)).advance()
    ages = np.stack([sim[f"propagator.{k}.age"][:, 0] for k in (1, 2)])
    reference = sim["propagator.reference"][:, 0].astype(int)
    assert (ages[reference - 1, np.arange(200)] == sim["propagator.reference.age"][:, 0]).all()
    # Step 1: the first is the reference from the start. Step 4: at 30 s the first is reset and the second takes over,
    # at 60 s the other way round, and so on.
    assert [int(reference[t - 1]) for t in (1, 29, 30, 59, 60, 90, 120)] == [1, 1, 2, 2, 1, 2, 1]
    resets = [[t for t in range(2, 200) if age[t - 1] == 0.0] for age in ages]
    assert resets == [[30, 90, 150], [60, 120, 180]]
    assert sim["propagator.reference.age"][30:, 0].min() == 30.0


def test_propagators_left_to_their_own_probabilities_grow_wide_and_blind():
    """In quiet flight the filter knows that Q is small; the transition matrix alone ends at one half and 50 Q_small."""
    quiet = CALM | {"flight": {"phases": [{"intensity": "low", "duration": 200.0}]}}
    q = {}
    for models in ("filter", "own"):
        sim = Simulation(scenario(duration=200.0, parameters=quiet, propagator_models=models), runs=3).advance()
        q[models] = sim["test.two-propagator.cns.statistic"][60:].mean()
    assert q["own"] < 0.5 * q["filter"]


def test_weights_are_those_of_inclusion_and_exclusion_and_sum_to_one():
    sim = Simulation(scenario([HARD], duration=60.0), runs=3).advance()
    weights = np.stack([sim[f"weight.{s}"] for s in SUBSETS], axis=-1)
    np.testing.assert_allclose(weights.sum(axis=-1), 1.0, atol=1e-12)
    beta = {aid: sim[f"validity.{aid}"] for aid in AIDS}
    for i, subset in enumerate(SUBSETS):
        inside = [a for a in AIDS if a in subset.split("-")]
        expected = np.prod([beta[a] if a in inside else 1.0 - beta[a] for a in AIDS], axis=0)
        np.testing.assert_allclose(weights[..., i], expected, atol=1e-12)


def test_the_two_thresholds_are_the_papers():
    sim = Simulation(scenario(duration=3.0)).advance()
    assert at(sim, "test.two-propagator.gps.threshold", 2.0)[0] == pytest.approx(11.35, abs=0.01)
    assert at(sim, "test.two-propagator.gps.doubt", 2.0)[0] == pytest.approx(6.25, abs=0.01)


def test_feedback_changes_the_strapdown_and_no_estimate():
    """To first order a correction only moves the origin of the errors: 0.1 % of sigma and of the statistics' scale."""
    often = Simulation(scenario(duration=120.0, feedback_period=7, parameters=CALM)).advance()
    never = Simulation(scenario(duration=120.0, feedback_period=3600, parameters=CALM)).advance()
    assert np.abs(often._state.navigator.ins.lla - never._state.navigator.ins.lla).max() > 1e-9
    for estimator in ("fused", "without-imm", "unprotected", "gps", "bd2"):
        for quantity in ("position.east", "velocity.north", "attitude.up"):
            difference = often[f"{estimator}.error.{quantity}"] - never[f"{estimator}.error.{quantity}"]
            assert (np.abs(difference) < 0.02 * never[f"{estimator}.sigma.{quantity}"]).all(), (estimator, quantity)


def test_without_scale_factors_every_filter_tells_the_truth_about_itself():
    """The truth is then the model's. NEES of 9 states over 12 runs at 300 s: filters share one flight, so the runs are
    the sample; band for a false failure of 1e-6. The IMM holds a model that is too wide: it may only be below."""
    sim = Simulation(scenario(duration=300.0, parameters=CALM, seed=4), runs=12).advance()
    low, high = chi2.ppf([5e-7, 1.0 - 5e-7], 9 * 12) / 12
    assert low < sim["without-imm.nees"][-1].mean() < high
    for estimator in ("fused", "unprotected", "gps", "bd2", "cns"):
        assert sim[f"{estimator}.nees"][-1].mean() < high, estimator


def test_q_in_the_innovation_form_is_chi_square_without_a_fault():
    """GPS, 20 runs of 300 s without scale factors. q of neighbouring seconds shares the reference's error, so runs are
    the sample: the mean of 20 means lies within 6 standard errors of 3."""
    sim = Simulation(scenario(duration=300.0, parameters=CALM, seed=6), runs=20).advance()
    means = sim["test.two-propagator-without-imm.gps.statistic"].mean(axis=0)
    assert means.mean() == pytest.approx(3.0, abs=6.0 * means.std(ddof=1) / np.sqrt(20))


# ---- faults


@pytest.mark.parametrize("form", ["two-propagator", "two-propagator-state"])
def test_a_hard_fault_is_out_at_once_harmless_and_forgiven(form):
    sim = Simulation(scenario([HARD], duration=120.0, driving_test=form), runs=4).advance()
    inside = (sim.time > 21.0) & (sim.time < 50.0)
    late = 29.0 if form == "two-propagator-state" else 1.0  # the state form sees it when the filter has swallowed it
    caught = sim[f"test.{form}.gps.alarm"][(sim.time >= 20.0) & (sim.time <= 20.0 + late)]
    assert (caught.max(axis=0) > 0).all()
    assert sim[f"test.{form}.bd2.alarm"][inside].mean() < 0.1
    if form == "two-propagator":
        assert (sim["validity.gps"][inside] == 0.0).all()
        assert np.abs(sim["fused.error.position.east"][inside]).max() < 5.0
    assert np.abs(sim["unprotected.error.position.east"][inside]).max() > 10.0
    assert (sim["used.gps"][sim.time > 110.0].mean(axis=0) > 0.8).all()


def test_a_fault_on_one_axis_is_told_from_one_on_another_aid():
    fault = {"channel": "bd2.position.up", "kind": "bias", "magnitude": 40.0, "start": 30.0}
    sim = Simulation(scenario([fault], duration=60.0), runs=3).advance()
    after = sim.time > 32.0
    assert (sim["test.two-propagator.bd2.alarm"][after] == 1.0).all()
    assert sim["test.two-propagator.gps.alarm"][after].mean() < 0.1
    assert {e.subject for e in sim.events if e.kind == "subsystem.isolated"} == {"bd2"}


def test_a_gross_fault_does_not_blind_the_imm():
    """1000 sigma on every aid in turn: the model probabilities stay numbers and come back."""
    faults = [
        {"channel": f"{aid}.{'attitude' if aid == 'cns' else 'position'}.all", "kind": "bias", "start": 20.0 + 10 * i}
        | {"magnitude": 3000.0, "end": 25.0 + 10 * i}
        for i, aid in enumerate(AIDS)
    ]
    sim = Simulation(scenario(faults, duration=120.0, parameters=CALM), runs=2).advance()
    np.testing.assert_allclose(sim["probability.small"] + sim["probability.large"], 1.0, atol=1e-12)
    assert (sim["weight.gps-bd2-cns"][-20:].mean(axis=0) > 0.7).all()
    assert np.abs(sim["fused.error.position.east"][-1]).max() < 5.0


def test_one_that_is_switched_off_or_has_no_reading_weighs_nothing_and_is_not_accused():
    sim = Simulation(
        scenario([{"channel": "cns.attitude.all", "kind": "dropout", "start": 10.0, "end": 30.0}], duration=40.0)
    )
    sim.advance(until=20.0).switch("bd2", False).advance()
    silent = (sim.time >= 10.0) & (sim.time < 30.0)
    assert (sim["validity.cns"][silent] == 0.0).all()
    assert np.isnan(sim["test.two-propagator.cns.statistic"][silent]).all()
    assert (sim["validity.bd2"][sim.time > 20.0] == 0.0).all()
    assert sim.subsystems["bd2"].health == "off"
    assert not [e for e in sim.events if e.kind == "subsystem.isolated" and e.subject in ("cns", "bd2")]


def test_one_axis_without_a_reading_leaves_the_other_two():
    sim = Simulation(
        scenario([{"channel": "gps.position.up", "kind": "dropout", "start": 10.0}], duration=20.0)
    ).advance()
    after = sim.time > 10.5
    assert (sim["test.two-propagator.gps.dof"][after] == 2.0).all()
    np.testing.assert_allclose(sim["test.two-propagator.gps.threshold"][after], chi2.isf(0.01, 2))


# ---- other masters, other IMUs


def test_the_federated_master_is_the_centralised_filter_while_nobody_is_left_out():
    """With ratio 1 there is one model; then fusion-reset equals the unprotected filter of all aids to rounding."""
    one_model = {"models": {"ratio": 1.0}}
    sim = Simulation(scenario(duration=60.0, parameters=one_model, master="federated", driving_test="none")).advance()
    for name in ("error.position.east", "sigma.velocity.up", "error.attitude.up"):
        np.testing.assert_allclose(sim[f"fused.{name}"], sim[f"unprotected.{name}"], rtol=1e-5, atol=1e-9)


def test_the_master_may_be_changed_in_flight_and_hands_its_estimate_over():
    sim = Simulation(scenario([HARD], duration=120.0)).advance(until=60.0)
    sim.configure(master="federated").copy()
    sim.advance(until=90.0)
    sim.configure(master="tolerant").copy()
    sim.advance()
    assert np.abs(sim["fused.error.position.east"][20:]).max() < 5.0
    step = np.abs(np.diff(sim["fused.error.position.east"][:, 0]))[[59, 60, 89, 90]]
    assert step.max() < 2.0


def test_the_redundant_imu_isolates_its_instrument_and_the_fused_estimate_does_not_notice():
    fault = {"channel": "imu.accelerometer.3y", "kind": "bias", "magnitude": 20.0, "unit": "mg", "start": 30.0}
    redundant = {"inertial": {"configuration": "redundant"}}
    sim = Simulation(scenario([fault], duration=90.0, parameters=redundant), runs=3).advance()
    isolated = {(e.run, e.subject) for e in sim.events if e.kind == "subsystem.isolated"}
    assert {(run, "imu.accelerometer.3") for run in range(3)} <= isolated
    assert not [s for _, s in isolated if s.startswith("imu.gyro")]
    after = sim.time > 60.0
    rms = [np.sqrt((sim[f"{e}.error.velocity.up"][after] ** 2).mean()) for e in ("fused", "unprotected")]
    assert rms[0] < 0.2 * rms[1]
    sound = Simulation(scenario(duration=90.0, parameters=redundant), runs=3).advance()
    assert not [e for e in sound.events if e.kind == "subsystem.isolated" and e.subject.startswith("imu")]
    assert np.isnan(Simulation(scenario(duration=3.0)).advance()["test.glt.imu.gyro.statistic"]).all()
