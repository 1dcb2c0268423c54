"""Who comes back, and what is forgotten of one that is left out, in the SINS/GPS/BD2/CNS system.

The two ways in which an aid could pass with its fault still there: a reference that it contaminated before it was out,
and a filter that it contaminated; and what the state form, which sees a fault when the filter has taken it in, owes to
the others.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from ftcore import Scenario, Simulation
from ftcore.detection import propagators, supervisor
from ftcore.estimation import federated
from ftcore.estimation.imm import Mixture
from ftcore.systems.sins_gps_bd2_cns import branch as fault_tolerant
from ftcore.systems.sins_gps_bd2_cns import exclusion, federation
from ftcore.systems.sins_gps_bd2_cns.branch import Measured, Motion
from ftcore.systems.sins_gps_bd2_cns.forms import Settings

RUNS, N = 3, 15
MU = np.array([0.9, 0.1])
SIGMA = 3.0
FAULT = 30.0
"""Of GPS, on three axes [m]: ten sigma."""
OFF = np.r_[np.full(3, FAULT), np.zeros(12)]


def measured():
    """SINS without an error; GPS reads FAULT off, BD2 and the star tracker are exact."""
    H = np.zeros((9, N))
    H[:3, :3] = H[3:6, :3] = H[6:, 6:9] = np.eye(3)
    y = np.r_[np.full(3, FAULT), np.zeros(6)]
    everywhere = (RUNS, 9)
    return Measured(
        np.broadcast_to(y, everywhere),
        np.broadcast_to(H, (RUNS, 9, N)),
        np.r_[np.full(6, SIGMA**2), np.full(3, 1e-10)],
        np.ones(everywhere, bool),
    )


def believing(filter_x, reference_x):
    """A filter and a reference propagator at these states, each sure of it to a metre."""
    P = np.broadcast_to(np.diag(np.r_[np.ones(6), np.full(9, 1e-10)]), (RUNS, N, N))
    start = fault_tolerant.start(np.tile(filter_x, (RUNS, 1)), P, MU)
    pair = propagators.renew(start.pair, np.tile(reference_x, (RUNS, 1)), P, np.ones(RUNS, bool))
    return replace(start, pair=pair)


def examined_by(branch, m, settings):
    (compared,) = fault_tolerant.compare([branch], m, settings)
    still = Motion(np.zeros((RUNS, 3)), np.zeros((RUNS, 3, 6)), np.zeros((RUNS, 6)))
    return fault_tolerant.examine(branch, compared, m, still, settings, True, True)[1]


def agrees(filter_x, reference_x):
    m = measured()
    examined = examined_by(believing(filter_x, reference_x), m, Settings())
    return exclusion.agrees(examined, m, 0.01)


@pytest.mark.parametrize(
    ("filter_x", "reference_x", "who"),
    [
        (np.zeros(N), np.zeros(N), [False, True, True]),
        (np.zeros(N), OFF, [False, False, True]),  # a propagator was reset while GPS was believed
        (OFF, np.zeros(N), [False, False, True]),  # the filter has not yet forgotten it
        (OFF, OFF, [True, False, True]),  # nobody is left who could know better
    ],
)
def test_an_aid_comes_back_only_if_it_agrees_with_the_reference_and_with_the_filter(filter_x, reference_x, who):
    assert (agrees(filter_x, reference_x) == who).all()


def test_the_state_form_would_let_it_back_where_the_innovation_form_does_not():
    """x_KF is the filter's prediction, moved by the gain: 30 m move it by 3, which is nothing beside the reference's
    own uncertainty."""
    branch, m = believing(np.zeros(N), np.zeros(N)), measured()
    wide = fault_tolerant.widen(branch, np.zeros((RUNS, N, N)))
    pair = propagators.renew(wide.pair, np.zeros((RUNS, N)), 4.0 * wide.pair.P[:, 0], np.ones(RUNS, bool))
    branch = replace(wide, pair=pair)
    examined = examined_by(branch, m, Settings())
    assert examined.state is not None
    assert not examined.state.alarm[:, 0].any()
    assert examined.innovation.alarm[:, 0].all()
    assert not exclusion.agrees(examined, m, 0.01)[:, 0].any()


def test_what_goes_back_is_the_filter_and_the_newer_propagator_and_only_where_it_is_asked_for():
    branch = believing(OFF, np.zeros(N))
    aged = fault_tolerant.alternate(branch, np.tile(OFF, (RUNS, 1)), branch.pair.P[:, 0])
    branch = replace(
        aged,
        mixture=Mixture(aged.mixture.x, aged.mixture.P, np.log(np.tile([0.3, 0.7], (RUNS, 1)))),
        age=np.tile([4.0, 34.0], (RUNS, 1)),
        drifting=np.log(np.tile([[[0.6, 0.4], [0.2, 0.8]]], (RUNS, 1, 1))),
    )
    assert (branch.pair.reference == 1).all()
    after = fault_tolerant.go_back(branch, np.array([True, False, True]))
    x_S, P_S = branch.pair.estimate()
    for run in (0, 2):
        assert (after.mixture.x[run] == x_S[run]).all()
        assert (after.mixture.P[run] == P_S[run]).all()
        assert (after.pair.x[run] == x_S[run]).all()
        assert (after.age[run] == 34.0).all()
        np.testing.assert_allclose(np.exp(after.drifting[run]), [[0.2, 0.8], [0.2, 0.8]])
    assert (after.mixture.log_mu == branch.mixture.log_mu).all(), "an aid says nothing of the manoeuvre"
    for name in ("mixture.x", "mixture.P", "pair.x", "pair.P", "age", "drifting"):
        new, old = after, branch
        for part in name.split("."):
            new, old = getattr(new, part), getattr(old, part)
        assert (new[1] == old[1]).all(), name


@pytest.mark.parametrize("mode", ["fusion-reset", "no-reset", "zero-reset", "rescale"])
def test_a_federation_that_starts_anew_knows_what_it_was_given_without_the_one_that_is_out(mode):
    P = np.broadcast_to(np.diag(np.arange(1.0, N + 1.0)), (RUNS, N, N))
    before = federation.start(federation.Estimate(np.tile(OFF, (RUNS, 1)), P), Settings(fusion_mode=mode))
    members = np.tile([False, True, True], (RUNS, 1))
    before = federation.FederationState(before.bank, before.fused, before.sharing, members)
    where = np.array([True, False, False])
    after = federation.restart(before, federation.Estimate(np.zeros((RUNS, N)), P), where)
    assert (after.fused.x[0] == 0.0).all()
    assert (after.bank.x[0] == 0.0).all()
    assert (after.bank.x[1:] == before.bank.x[1:]).all()
    assert (after.bank.P[1:] == before.bank.P[1:]).all()
    made = federated.master_estimate(after.bank, *after.bank.locals, members, after.sharing)
    np.testing.assert_allclose(made.P[0], P[0], rtol=1e-9, atol=1e-12)
    assert (made.x[0] == 0.0).all()


def test_only_an_isolation_by_the_state_form_is_forgotten_and_only_where_isolation_leaves_out():
    state = supervisor.start(RUNS, 3)
    alarms = np.tile([True, False, False], (RUNS, 1))
    for _ in range(2):
        state, decision = supervisor.step(state, alarms, ~alarms, np.ones((1, 3), bool), supervisor.Rules())
    assert decision.just_isolated[:, 0].all()

    def forgets(**settings):
        return exclusion.forgets(decision, Settings(**settings)).all()

    assert forgets(master="federated", driving_test="two-propagator-state")
    assert forgets(exclusion="isolation", driving_test="two-propagator-state")
    assert not forgets(driving_test="two-propagator-state"), "Yang 2016: q of each second alone weighs an aid"
    assert not forgets(master="federated")


@pytest.mark.parametrize("settings", [{"master": "federated"}, {"exclusion": "isolation"}], ids=str)
def test_given_the_state_form_drives_then_a_faulty_aid_is_out_once_and_nobody_else_pays_for_it(settings):
    """GPS is 60 m off for half a minute, from the very second at which a propagator is reset. In four runs it is
    isolated four times and comes back after the fault; without all this it came back nine times with its 60 m, and the
    position was 24 m wrong, forty times its sigma. The filter has taken two seconds of the fault in when the state form
    sees it, and has forgotten them at the end: NEES of nine states over four runs, band for a false failure of 1e-6."""
    fault = {"channel": "gps.position.all", "kind": "bias", "magnitude": 60.0, "start": 60.0, "end": 90.0}
    document = {"system": "sins-gps-bd2-cns", "duration": 120.0, "seed": 5, "faults": [fault]}
    confirming = {"confirm": 2, "within": 3}
    document["settings"] = {"driving_test": "two-propagator-state", **confirming, **settings}
    sim = Simulation(Scenario.model_validate(document), runs=4).advance()
    changes = [(e.kind.split(".")[1], e.time) for e in sim.events if e.subject == "gps" and e.run >= 0]
    isolated = [time for what, time in changes if what == "isolated" and time >= 60.0]
    assert len(isolated) == 4
    assert max(isolated) <= 64.0
    assert all(time > 90.0 for what, time in changes if what == "readmitted" and time >= 60.0)
    assert (sim["used.gps"][-1] == 1.0).all()
    assert (sim["used.bd2"][63:] == 1.0).mean() > 0.97
    assert sim["fused.nees"][-1].mean() < chi2.isf(1e-6, 9 * 4) / 4
    assert {e.time for e in sim.events if e.kind == "filter.reset" and e.subject == "fusion"} >= set(isolated)
