"""System C flown again without a culprit: the same as if the culprit had not been heard since then."""

from unittest import mock

import numpy as np
import pytest
from scipy.stats import chi2

from ftcore import Fault, Scenario, Simulation
from ftcore.systems.past import SPACING, SPAN
from ftcore.systems.sins_gps_bd2_cns import evidence
from ftcore.systems.sins_gps_bd2_cns.hindsight import Hindsight, Review

GPS, BD2, CNS = range(3)
STATE = {"driving_test": "two-propagator-state"}
ISOLATION = {"exclusion": "isolation"}
MATCHED = {"inertial": {"scale_factor": 0.0}}
"""The truth is then the filters' model, and NEES is chi-square."""
NO_RESET = {"master": "federated", "fusion_mode": "no-reset"}
OTHER_MODES = [
    {},
    ISOLATION,
    STATE,
    *({"master": "federated", "fusion_mode": mode} for mode in ("fusion-reset", "zero-reset", "rescale")),
    {**STATE, "master": "federated"},
]
MODES = [
    {**STATE, **ISOLATION},
    NO_RESET,
    *(pytest.param(settings, marks=pytest.mark.long) for settings in OTHER_MODES),
]
ALL_MODES = [{**STATE, **ISOLATION}, NO_RESET, *OTHER_MODES]
PARTS = [f"{quantity}.{axis}" for quantity in ("position", "velocity", "attitude") for axis in ("east", "north", "up")]


def flight(settings=None, faults=(), duration=120.0, runs=2, seed=6, parameters=None, subsystems=None):
    document = {
        "system": "sins-gps-bd2-cns",
        "duration": duration,
        "seed": seed,
        "settings": settings or {},
        "faults": list(faults),
        "parameters": parameters or {},
        "subsystems": subsystems or {},
    }
    return Simulation(Scenario.model_validate(document), runs=runs)


def fault(channel, magnitude, start, end, kind="bias", **fields):
    return Fault(channel=channel, kind=kind, magnitude=magnitude, start=start, end=end, **fields)


def flown_again(sim, aid, since):
    """The protected part as it is, and as it is when flown again without an aid since some epoch."""
    navigator, now = sim._assembly.navigator, sim._state.navigator
    named = np.zeros((sim.runs, 3), bool)
    named[:, aid] = True
    numbers = np.broadcast_to(np.asarray(since), (sim.runs,))[:, None] * np.ones(3, np.int64)
    _, again, _ = navigator._hindsight.fly_again(now.history.past, now.protected, Review(named, numbers))
    return now.protected, again


def assert_same(found, wanted, tolerance=1e-7):
    """Filter, propagators and federation, in units of their sigma."""
    pairs = [(found.main.mixture, wanted.main.mixture), (found.main.pair, wanted.main.pair)]
    assert (found.federation is None) == (wanted.federation is None)
    if wanted.federation is not None:
        pairs += [(found.federation.bank, wanted.federation.bank), (found.federation.fused, wanted.federation.fused)]
    for a, b in pairs:
        sigma = np.sqrt(np.diagonal(b.P, axis1=-2, axis2=-1))
        np.testing.assert_allclose(a.x / sigma, b.x / sigma, rtol=0.0, atol=tolerance)
        unit = sigma[..., :, None] * sigma[..., None, :]
        np.testing.assert_allclose(a.P / unit, b.P / unit, rtol=0.0, atol=tolerance)
    np.testing.assert_array_equal(found.supervisor.health, wanted.supervisor.health)


@pytest.mark.parametrize("settings", MODES, ids=str)
def test_given_nobody_is_to_blame_then_what_is_flown_again_is_what_was_flown(settings):
    """The "culprit" is BD2, which is switched off. Behind it lie corrections of the strapdown, propagators that took
    turns, and an isolation; the two runs are flown again from different epochs."""
    faults = [fault("gps.position.up", 60.0, 66.0, 74.0)]
    sim = flight({"feedback_period": 25, **settings}, faults, subsystems={"bd2": False}).advance(until=85.0)
    now, again = flown_again(sim, BD2, [24, 47])
    assert_same(again, now)


def test_given_instruments_and_the_master_have_changed_then_what_is_flown_again_is_what_was_flown():
    lost = fault("imu.gyro.2x", 200.0, 44.0, None, unit="deg/h")
    sim = flight(faults=[lost], parameters={"inertial": {"configuration": "redundant"}}, subsystems={"bd2": False})
    sim.advance(until=40.0).configure(master="federated")
    sim.advance(until=52.0).configure(master="tolerant", propagator_models="own")
    sim.advance(until=60.0)
    assert any(e.kind == "imu.reconfigured" for e in sim.events)
    now, again = flown_again(sim, BD2, 22)
    assert_same(again, now)


@pytest.mark.parametrize("settings", MODES, ids=str)
def test_given_gps_is_taken_out_afterwards_then_all_is_as_in_a_flight_that_did_not_hear_it(settings):
    """Nobody is isolated in either; the strapdown is not corrected meanwhile, for the two would correct it by different
    errors."""
    sim = flight({"feedback_period": 3600, **settings}).advance(until=24.0)
    twin = sim.fork()
    twin.inject(Fault(channel="gps.position.all", kind="dropout", start=25.0))
    sim.advance(until=70.0)
    twin.advance(until=70.0)
    now, again = flown_again(sim, GPS, 25)
    wanted = twin._state.navigator.protected
    assert_same(again, wanted)
    assert np.abs(now.main.mixture.x - again.main.mixture.x).max() > 0.1, "GPS had its part"


def test_given_a_ramp_then_each_run_is_flown_again_from_before_it_was_noticed_and_the_event_says_since_when():
    """0.7 m/s, noticed after some ten seconds, in every run in an epoch of its own."""
    ramp = fault("gps.position.north", 0.7, 80.0, 120.0, kind="ramp")
    sim = flight(ISOLATION, [ramp], runs=4, seed=11).advance(until=119.0)
    isolated = {e.run: e.time for e in sim.events if e.kind == "subsystem.isolated" and e.subject == "gps"}
    again = {e.run: e for e in sim.events if e.kind == "filter.reflown" and e.time == isolated.get(e.run)}
    assert set(isolated) == set(again) == set(range(4))
    for run, event in again.items():
        assert event.subject == "gps"
        assert event.detail["since [s]"] < isolated[run] - 3.0
        assert event.detail["epochs"] == event.time - event.detail["since [s]"] + 1.0
    assert len(set(isolated.values())) > 1


@pytest.mark.parametrize("settings", [{"master": "federated", **STATE}], ids=str)
def test_given_runs_are_flown_again_from_different_epochs_then_each_is_what_it_is_alone(settings):
    ramp = fault("gps.position.north", 0.7, 80.0, 120.0, kind="ramp")
    batch = flight(settings, [ramp], runs=3, seed=11).advance(until=100.0)
    assert any(e.kind == "filter.reflown" for e in batch.events)
    alone = Simulation(batch.scenario, runs=1, seed=11, first_run=2).advance(until=100.0)
    for part in PARTS:
        np.testing.assert_allclose(
            batch[f"fused.error.{part}"][:, 2], alone[f"fused.error.{part}"][:, 0], rtol=1e-6, atol=1e-9
        )


def test_given_a_flight_that_was_flown_again_is_rewound_then_it_comes_to_the_same_bits():
    step = fault("bd2.position.up", 25.0, 80.0, 110.0)
    sim = flight(STATE, [step]).advance(until=112.0)
    assert any(e.kind == "filter.reflown" for e in sim.events)
    before = sim.recording.rows.copy()
    sim.rewind(to=84.0)
    assert np.array_equal(before, sim.advance(until=112.0).recording.rows, equal_nan=True)


@pytest.mark.parametrize("settings", [{}, pytest.param(STATE, marks=pytest.mark.long)], ids=str)
def test_given_nothing_fails_then_looking_back_changes_no_bit(settings):
    """Four flights of 100 s, with turns; somebody is flown again by chance in 1e-4 of such flights or less."""
    sim = flight(settings, duration=100.0, runs=4, seed=12).advance()
    assert not [e for e in sim.events if e.kind in ("filter.reflown", "subsystem.isolated") and e.run >= 0]

    def remembered(self, history, epoch, state, outcome):
        return history, state, outcome, None

    with (
        mock.patch.object(Hindsight, "review", remembered),
        mock.patch("ftcore.systems.sins_gps_bd2_cns.navigator.hindsight.conclude", lambda history, *_: history),
        mock.patch("ftcore.systems.sins_gps_bd2_cns.navigator.hindsight.keep", lambda history, _: history),
    ):
        blind = flight(settings, duration=100.0, runs=4, seed=12).advance()
    assert np.array_equal(sim.recording.rows, blind.recording.rows, equal_nan=True)


@pytest.mark.parametrize("aid", ["gps", "bd2"])
def test_given_a_small_bias_then_the_likelihood_ratio_names_who_has_it_and_since_when(aid):
    """7 m on one of two receivers: 25 s later the ratio is 60 or more, its limit 39; the onset of a step of 2.4 sigma
    is found to a few epochs (10, false failure below 1e-3 for four runs)."""
    sim = flight({"driving_test": "none"}, [fault(f"{aid}.position.east", 7.0, 80.0, 120.0)], runs=4).advance(until=105)
    navigator, past = sim._assembly.navigator, sim._state.navigator.history.past
    nobody = np.zeros((4, len(past.epochs), 3), bool)
    ratio, age, limit = evidence.weigh(past.banks[0][1], past.epochs, nobody, navigator._model, navigator._R)
    who = {"gps": GPS, "bd2": BD2}[aid]
    assert (ratio.argmax(axis=-1) == who).all()
    assert (ratio[:, who] > limit).all()
    np.testing.assert_allclose(105 - age[:, who], 80, atol=10)


FAULTS = {
    "gps 6 m": ("gps.position.east", "bias", 6.0),
    "gps 100 m": ("gps.position.up", "bias", 100.0),
    "bd2 0.5 m/s": ("bd2.position.north", "ramp", 0.5),
    "cns 60 arcsec": ("cns.attitude.roll", "bias", 60.0),
}
MORE = {
    "gps 20 m": ("gps.position.north", "bias", 20.0),
    "bd2 6 m": ("bd2.position.up", "bias", 6.0),
    "bd2 20 m": ("bd2.position.east", "bias", 20.0),
    "gps 0.1 m/s": ("gps.position.east", "ramp", 0.1),
    "gps 2 m/s": ("gps.position.up", "ramp", 2.0),
    "cns 20 arcsec": ("cns.attitude.pitch", "bias", 20.0),
    "cns 600 arcsec": ("cns.attitude.heading", "bias", 600.0),
}


def recovered(settings, what, runs, seed, p, start=100.0):
    """40 s of a fault, and how it stands 60 s after its end: NEES of all runs within its band (above, for the IMM holds
    a model that is too wide), no error beyond what chance allows, and nobody out. Returns what is wrong."""
    channel, kind, magnitude = {**FAULTS, **MORE}[what]
    sim = flight(settings, [fault(channel, magnitude, start, start + 40.0, kind)], start + 100.0, runs, seed, MATCHED)
    sim.advance()
    wrong = []
    nees = np.median(sim["fused.nees"][-5:], axis=0).mean()
    if nees > chi2.isf(p, 9 * runs) / runs:
        wrong.append(f"NEES {nees:.1f}")
    ratio = np.stack([sim[f"fused.error.{x}"][-5:] / sim[f"fused.sigma.{x}"][-5:] for x in PARTS])
    largest = np.median(np.abs(ratio), axis=1).max()
    if largest > np.sqrt(chi2.isf(p / (runs * len(PARTS)), 1)):
        wrong.append(f"{largest:.1f} sigma")
    out = {aid: np.median(sim[f"used.{aid}"][-5:], axis=0).min() for aid in ("gps", "bd2", "cns")}
    return wrong + [f"{aid} is out" for aid, used in out.items() if used < 1.0]


@pytest.mark.parametrize(
    ("settings", "what"),
    [({}, "cns 60 arcsec"), ({**STATE, **ISOLATION}, "gps 6 m"), ({"master": "federated"}, "bd2 0.5 m/s")],
    ids=str,
)
def test_given_a_fault_of_one_aid_then_a_minute_later_the_estimate_has_none_of_it(settings, what):
    """Two runs; false failure 1e-5 a case."""
    assert recovered(settings, what, 2, 21, 1e-5, start=60.0) == []


@pytest.mark.long
@pytest.mark.parametrize("what", {**FAULTS, **MORE})
@pytest.mark.parametrize("settings", ALL_MODES, ids=str)
def test_given_any_fault_of_one_aid_and_any_mode_then_a_minute_later_the_estimate_has_none_of_it(settings, what):
    """Twelve runs; false failure 1e-3 a case. 4.4 sigma is what chance allows the largest of 108 errors."""
    assert recovered(settings, what, 12, 77, 1e-3) == []


def test_given_a_long_flight_then_what_is_remembered_is_bounded():
    sim = flight(runs=1, duration=130.0).advance()
    past = sim._state.navigator.history.past
    assert SPAN <= len(past.epochs) < SPAN + SPACING
    assert len(past.banks) <= SPAN // SPACING + 1
