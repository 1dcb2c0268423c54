"""Interacting multiple models: several Kalman filters of one state, weighed by how well each explains the readings.

The models share the state and may differ in transition and in process noise, as quiet flight and manoeuvre do. An epoch
is `predict` (interaction, then every model's prediction) and a measurement update, either the plain one here, `update`,
or the fault-tolerant one of :mod:`ftcore.estimation.tolerant_fusion`. `combine` gives one mean and covariance.

Mode probabilities are kept as logarithms throughout. A likelihood underflows at about 38 standard deviations, and a
floor under it makes all models equally likely just when a gross fault comes; a logarithm does neither, and one step of
the transition matrix brings a probability of e^-1e6 back to what that matrix says.

Shapes. Leading axes `...` are `(runs,)`, or `(runs, filters)` for several such filters at once; a 1 there broadcasts.

    x (..., M, n) states of the models     P (..., M, n, n) covariances     log_mu (..., M) log mode probabilities
    Phi (..., n, n), the same in all models, or (..., M, n, n)    Q (..., M, n, n)    y (..., m)    H (..., m, n)

Sources: C. Yang, A. Mohammadi and Q.-W. Chen, Sensors 16 (2016), section 3.1, equations (7)-(11); H.A.P. Blom and
Y. Bar-Shalom, The interacting multiple model algorithm, IEEE Trans. AC 33 (1988). Two slips of the former: the global
prediction is weighed by the predicted mode probabilities, not by those of the epoch before, and the gain is
P_{k|k} H' R^-1, not that of the prior.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ftcore.estimation import kalman
from ftcore.estimation.kalman import Array, Mask


@dataclass(frozen=True, slots=True)
class Mixture:
    """What the models hold: x (..., M, n), P (..., M, n, n), and the logarithms of the mode probabilities, (..., M)."""

    x: Array
    P: Array
    log_mu: Array

    @property
    def mu(self) -> Array:
        """Mode probabilities, (..., M): they sum to one."""
        return np.asarray(np.exp(self.log_mu))


def start(x: Array, P: Array, mu: ArrayLike) -> Mixture:
    """All models at x (..., n), P (..., n, n), with mode probabilities `mu` (M,).

    Raises ValueError unless the probabilities are positive and sum to one.
    """
    p = _distribution(mu, "the initial mode probabilities")
    M = len(p)
    return Mixture(
        np.repeat(x[..., None, :], M, axis=-2),
        np.repeat(P[..., None, :, :], M, axis=-3),
        np.broadcast_to(np.log(p), (*x.shape[:-1], M)),
    )


def transition_matrix(p: ArrayLike) -> Array:
    """The matrix p[i, j] = P(model j now | model i before), (M, M), as the functions here take it.

    Raises ValueError unless it is square with rows that are distributions. A zero is allowed off the diagonal (a change
    that never happens), not on it.
    """
    matrix = np.asarray(p, dtype=float)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"a transition matrix is square, one row a model; got an array of shape {matrix.shape}")
    if not (np.isfinite(matrix).all() and (matrix >= 0.0).all() and (np.diagonal(matrix) > 0.0).all()):
        raise ValueError(
            f"transition probabilities lie between 0 and 1, above 0 on the diagonal; got {matrix.tolist()}"
        )
    if not np.allclose(matrix.sum(axis=1), 1.0, rtol=0.0, atol=1e-9):
        raise ValueError(f"every row of a transition matrix sums to 1; got sums {matrix.sum(axis=1).tolist()}")
    return matrix


def predicted_probabilities(log_mu: Array, transition: Array) -> Array:
    """Logarithms of the predicted mode probabilities c_j = sum_i p_ij mu_i, (..., M)."""
    return np.asarray(np.logaddexp.reduce(_joint(log_mu, transition), axis=-2))


def mix(mixture: Mixture, transition: Array) -> Mixture:
    """Interaction: each model starts from all of them, weighed by mu_i|j = p_ij mu_i / c_j.

    `transition` (M, M) as from `transition_matrix`. The probabilities become the predicted ones, c_j; the combined mean
    and covariance do not change. A model that cannot be reached (c_j = 0) keeps its own. Source: (7)-(8).
    """
    joint = _joint(mixture.log_mu, transition)
    log_c = np.logaddexp.reduce(joint, axis=-2)
    reached = np.isfinite(log_c)[..., None, :]
    if reached.all():
        weights = np.exp(joint - log_c[..., None, :])
    else:
        weights = np.where(
            reached, np.exp(joint - np.where(reached, log_c[..., None, :], 0.0)), np.eye(len(transition))
        )
    x, P = _moments(mixture.x, mixture.P, weights.swapaxes(-1, -2))
    return Mixture(x, P, log_c)


def predict(mixture: Mixture, Phi: Array, Q: Array, transition: Array) -> Mixture:
    """Interaction, then every model's prediction with its own Q (..., M, n, n): once a measurement period.

    Phi (..., n, n), common to the models, or (..., M, n, n). `combine` of the result is the global prediction, which
    takes the predicted mode probabilities. Source: (7)-(10).
    """
    mixed = mix(mixture, transition)
    common = Phi.ndim < mixed.P.ndim
    x, P = kalman.predict(mixed.x, mixed.P, Phi[..., None, :, :] if common else Phi, Q)
    return Mixture(x, P, mixed.log_mu)


def combine(mixture: Mixture) -> tuple[Array, Array]:
    """Mean (..., n) and covariance (..., n, n) of the mixture: sum mu_j x_j, sum mu_j [P_j + (x_j - x)(x_j - x)'].

    Source: (9)-(11).
    """
    if mixture.log_mu.shape[-1] == 1:
        return mixture.x[..., 0, :], mixture.P[..., 0, :, :]
    x, P = _moments(mixture.x, mixture.P, mixture.mu[..., None, :])
    return np.asarray(x[..., 0, :]), np.asarray(P[..., 0, :, :])


def update(mixture: Mixture, y: Array, H: Array, R: Array, valid: Mask | None = None) -> tuple[Mixture, kalman.Update]:
    """The plain IMM update: every model corrected by the measurement, the probabilities by its likelihood.

    y (..., m), H (..., m, n), R and `valid` as in `kalman.update`, without a model axis. Returns the mixture, and the
    models' updates with leading axes (..., M). Where no row is valid nothing changes. Source: (10)-(11).
    """
    R_of_models = R
    if R.ndim == y.ndim + 1:
        R_of_models = R[..., None, :, :]
    elif R.ndim == y.ndim:
        R_of_models = R[..., None, :]
    u = kalman.update(
        mixture.x,
        mixture.P,
        y[..., None, :],
        H[..., None, :, :],
        R_of_models,
        None if valid is None else valid[..., None, :],
    )
    return Mixture(u.x, u.P, reweigh(mixture.log_mu, u.log_likelihood)), u


def reweigh(log_mu: Array, log_likelihood: Array, axis: int = -1) -> Array:
    """Bayes' rule for the mode probabilities, all in logarithms: mu_j = c_j Lambda_j / sum_i c_i Lambda_i, (..., M).

    `log_mu`: the predicted probabilities, `log_likelihood` (..., M). `axis`: where the models stand, if not last.
    Source: the model probability update of 3.1.
    """
    joint = log_mu + (log_likelihood - log_likelihood.max(axis=axis, keepdims=True))
    return np.asarray(joint - np.logaddexp.reduce(joint, axis=axis, keepdims=True))


def shift(mixture: Mixture, dx: Array) -> Mixture:
    """Feedback: what the states are errors of was corrected by dx (..., n), so every model's x loses dx."""
    return replace(mixture, x=mixture.x - dx[..., None, :])


def _joint(log_mu: Array, transition: Array) -> Array:
    """log p_ij + log mu_i, (..., M, M)."""
    with np.errstate(divide="ignore"):
        return np.asarray(log_mu[..., :, None] + np.log(transition))


def _moments(x: Array, P: Array, weights: Array) -> tuple[Array, Array]:
    """Moments of K mixtures of M models: weights (..., K, M), x (..., M, n), P (..., M, n, n).

    The spread is that of all pairs: sum_i w_i (x_i - x)(x_i - x)' = sum_{i<j} w_i w_j (x_i - x_j)(x_i - x_j)'.
    """
    M, n = x.shape[-2:]
    mean = weights @ x
    covariance = (weights @ P.reshape(*P.shape[:-2], n * n)).reshape(*mean.shape, n)
    for i in range(M):
        for j in range(i):
            apart = x[..., None, i, :] - x[..., None, j, :]
            both = weights[..., i] * weights[..., j]
            covariance += both[..., None, None] * (apart[..., :, None] * apart[..., None, :])
    return mean, covariance


def _distribution(p: ArrayLike, what: str) -> Array:
    given = np.asarray(p, dtype=float)
    if given.ndim != 1 or not given.size or not (given > 0.0).all() or abs(given.sum() - 1.0) > 1e-9:
        raise ValueError(f"{what} are positive and sum to 1; got {given.tolist()}")
    return given
