"""The bank of the SINS/GPS/BD2/CNS system against one filter after the other, as their own modules carry them."""

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest

from ftcore import Scenario, Simulation
from ftcore.detection import propagators
from ftcore.estimation import imm
from ftcore.systems.sins_gps_bd2_cns import bank

ALONE_IN_ITS_IMM = np.ones((1, 1))


def overheard(configuration, runs):
    """What the bank is given in an epoch of a flight with GPS off, so that models and propagators have gone apart."""
    document = {
        "id": "bank",
        "title": "Bank",
        "summary": "",
        "hint": "",
        "source": "FTLab",
        "system": "sins-gps-bd2-cns",
        "seed": 3,
        "duration": 40.0,
        "parameters": {"inertial": {"configuration": configuration}},
        "subsystems": {"gps": False},
    }
    sim = Simulation(Scenario.model_validate(document), runs=runs).advance(epochs=35)
    with mock.patch.object(bank, "predict", wraps=bank.predict) as predict:
        sim.step()
    return predict.call_args.args


def assert_same(found, wanted):
    """Means in units of their sigma, covariances of unit diagonal."""
    sigma = np.sqrt(np.diagonal(wanted.P, axis1=-2, axis2=-1))
    np.testing.assert_allclose(found.x / sigma, wanted.x / sigma, rtol=1e-12, atol=1e-12)
    unit = sigma[..., :, None] * sigma[..., None, :]
    np.testing.assert_allclose(found.P / unit, wanted.P / unit, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize(("configuration", "runs"), [("three-axis", 1), ("three-axis", 3), ("redundant", 2)])
def test_given_an_epoch_when_all_are_carried_together_then_each_is_what_it_would_be_alone(configuration, runs, own):
    main, conventional, unprotected, alone, Phi, Q, transition, _ = overheard(configuration, runs)
    if own:
        main = replace(main, drifting=np.log(np.array([[[0.7, 0.3], [0.2, 0.8]]]) * np.ones((runs, 1, 1))))
    after = bank.predict(main, conventional, unprotected, alone, Phi, Q, transition, own)

    by_itself = imm.predict(main.mixture, Phi[:, 0], Q[:, 0], transition)
    drifting = imm.predicted_probabilities(main.drifting, transition)
    pair = propagators.carry(main.pair, Phi[:, 0], Q[:, 0], np.exp(drifting) if own else by_itself.mu)
    assert_same(after[0].mixture, by_itself)
    assert_same(after[0].pair, pair)
    np.testing.assert_allclose(after[0].mixture.mu, by_itself.mu, rtol=1e-12)
    np.testing.assert_allclose(after[0].drifting, drifting, rtol=1e-12)
    np.testing.assert_array_equal(after[0].age, main.age + 1.0)

    one = imm.predict(conventional.mixture, Phi[:, 0], Q[:, 0, :1], ALONE_IN_ITS_IMM)
    assert_same(after[1].mixture, one)
    assert_same(after[1].pair, propagators.carry(conventional.pair, Phi[:, 0], Q[:, 0, :1], one.mu))
    np.testing.assert_array_equal(after[1].age, conventional.age + 1.0)

    wanted = imm.predict(unprotected, Phi[:, -1], Q[:, -1], transition)
    assert_same(after[2], wanted)
    np.testing.assert_allclose(after[2].mu, wanted.mu, rtol=1e-12)
    wanted = imm.predict(alone, Phi[:, :1], Q[:, :1], transition)
    assert_same(after[3], wanted)
    np.testing.assert_allclose(after[3].mu, wanted.mu, rtol=1e-12)
