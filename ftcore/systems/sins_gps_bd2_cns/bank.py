"""All estimates of the SINS/GPS/BD2/CNS system, carried over one epoch together: one product for fifteen covariances.

    0, 1    main          the models of the fault-tolerant filter with the IMM
    2, 3    unprotected   those of the IMM of all aids without any test, on the unprotected strapdown
    4 - 9   alone         those of the three IMMs of one aid each, in pairs
    10      conventional  the fault-tolerant filter without the IMM: one model, nothing to mix
    11, 12  propagators   of the first, with the noise of what its models are believed
    13, 14  propagators   of the conventional one

The first five interact, each in itself; then all go on with the transition of their strapdown and their part of its
noise.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftcore.estimation import imm, kalman
from ftcore.estimation.imm import Mixture
from ftcore.systems.sins_gps_bd2_cns.branch import Branch, carried

Array = NDArray[np.float64]

MODELS, INTERACTING = 2, 5
MAIN, UNPROTECTED, ALONE, CONVENTIONAL = slice(0, 2), slice(2, 4), slice(4, 10), slice(10, 11)
PAIR, CONVENTIONAL_PAIR = slice(11, 13), slice(13, 15)
SIZE, MIXED = 15, slice(0, INTERACTING * MODELS)
INS = np.array([0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0])
"""Which strapdown each estimate belongs to, where there are two: 0 protected, 1 unprotected."""
MODEL = np.array([0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 0, 0, 0, 0])
"""Which model's noise drives it: 0 small, 1 large."""


def predict(
    main: Branch,
    conventional: Branch,
    unprotected: Mixture,
    alone: Mixture,
    Phi: Array,
    Q: Array,
    transition: Array,
    own: bool,
) -> tuple[Branch, Branch, Mixture, Mixture]:
    """One epoch with Phi ``(runs, S, n, n)`` and Q ``(runs, S, 2, n, n)`` of the S strapdowns.

    ``own``: the propagators' noise is by their own model probabilities, not by the filter's of the moment.
    """
    all_of_them = (main.mixture, unprotected, alone, conventional.mixture, main.pair, conventional.pair)
    runs, n = len(main.mixture.x), main.mixture.x.shape[-1]
    x = np.concatenate([a.x.reshape(runs, -1, n) for a in all_of_them], axis=1)
    P = np.concatenate([a.P.reshape(runs, -1, n, n) for a in all_of_them], axis=1)
    log_mu = np.concatenate([main.mixture.log_mu[:, None], unprotected.log_mu[:, None], alone.log_mu], axis=1)
    models = (runs, INTERACTING, MODELS, n)
    mixed = imm.mix(Mixture(x[:, MIXED].reshape(models), P[:, MIXED].reshape(*models, n), log_mu), transition)
    x[:, MIXED], P[:, MIXED] = mixed.x.reshape(runs, -1, n), mixed.P.reshape(runs, -1, n, n)
    drifting = imm.predicted_probabilities(main.drifting, transition)
    noise = _noise(Q, np.exp(drifting if own else mixed.log_mu[:, :1]))
    x, P = kalman.predict(x, P, Phi if Phi.shape[1] == 1 else Phi[:, INS], noise)
    P = kalman.sound(P)
    log_mu = mixed.log_mu
    one = Mixture(x[:, CONVENTIONAL], P[:, CONVENTIONAL], conventional.mixture.log_mu)
    return (
        carried(main, Mixture(x[:, MAIN], P[:, MAIN], log_mu[:, 0]), x[:, PAIR], P[:, PAIR], drifting),
        carried(conventional, one, x[:, CONVENTIONAL_PAIR], P[:, CONVENTIONAL_PAIR], conventional.drifting),
        Mixture(x[:, UNPROTECTED], P[:, UNPROTECTED], log_mu[:, 1]),
        Mixture(x[:, ALONE].reshape(alone.x.shape), P[:, ALONE].reshape(alone.P.shape), log_mu[:, 2:]),
    )


def _noise(Q: Array, believed: Array) -> Array:
    """Process noise ``(runs, 15, n, n)`` of every estimate, from Q ``(runs, S, 2, n, n)``.

    ``believed (runs, 1 or 2, 2)``: probabilities of the models that drive the main filter's propagators.
    """
    runs, S, _, n, _ = Q.shape
    weights = np.repeat(_weights(S), runs, axis=0)
    weights[:, PAIR, :MODELS] = believed
    return np.asarray((weights @ Q.reshape(runs, S * MODELS, n * n)).reshape(runs, SIZE, n, n))


@lru_cache(maxsize=2)
def _weights(S: int) -> Array:
    """What part of each strapdown's and model's noise drives each estimate, ``(1, 15, S * 2)``: all of one of them."""
    column = MODELS * np.minimum(INS, S - 1) + MODEL
    return np.asarray((column[:, None] == np.arange(S * MODELS))[None].astype(np.float64))
