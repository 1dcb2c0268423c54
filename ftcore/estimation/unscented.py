"""The unscented Kalman filter, for any number of filters at once.

It needs no Jacobian: 2 L + 1 points with the mean and covariance of the state go through the model, and come out with
those of what the model makes of it.

Shapes. Leading axes `...` are free (runs, suspects) and broadcast: x (..., L), P and Q (..., L, L), y (..., m);
R (..., m) variances, or (..., m, m) when it has one axis more than y. The models are functions of the caller's: `f`
takes points (..., 2 L + 1, L) and returns as many, one step later; `h` takes them and returns (..., 2 L + 1, m).
Nothing given is changed in place.

Sources: H.S. Kim et al. (2005), (33)-(47); E.A. Wan and R. van der Merwe, The unscented Kalman filter for nonlinear
estimation (2000), for the weights.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ftcore.estimation.kalman import Array, Ints, Mask, cholesky, symmetric, triangular_inverse

Model = Callable[[Array], Array]


@dataclass(frozen=True)
class Rule:
    """How points are laid and weighted.

    With the defaults the points lie sqrt(L) standard deviations out and no weight is negative, so that covariances stay
    positive. Raises ValueError when the points would not spread.
    """

    alpha: float = 1.0
    """Spread of the points about the mean."""
    beta: float = 2.0
    """What is known of the fourth moment; 2 for a Gaussian."""
    kappa: float = 0.0
    redraw: bool = True
    """Lay the points anew after the time update, so that they hold Q too. As (41) is printed the points that f gave go
    on into h, and the share of Q is missing in (43) and (44)."""

    def weights(self, L: int) -> tuple[float, Array, Array]:
        """L + lambda, and the weights of the mean and of the covariance, (2 L + 1,) each."""
        return _weights(self.alpha, self.beta, self.kappa, L)


@dataclass(frozen=True, slots=True)
class Prediction:
    """A state after the time update."""

    x: Array
    """(39), (..., L)."""
    P: Array
    """(40), (..., L, L)."""
    points: Array
    """What h is to see, (..., 2 L + 1, L)."""


@dataclass(frozen=True, slots=True)
class Update:
    """A state after the measurement update, and how the measurement compared with its prediction."""

    x: Array
    """(46), (..., L)."""
    P: Array
    """(47), (..., L, L), exactly symmetric when the prior was."""
    innovation: Array
    """y less (42), (..., m); 0 where not valid."""
    covariance: Array
    """(43), (..., m, m); a row that is not valid is the unit row."""
    gain: Array
    """(45), (..., L, m)."""
    statistic: Array
    """Innovation squared, normalised by its covariance, (...): chi-square on `dof` while the model holds."""
    dof: Ints
    """Valid rows, (...)."""


def sigma_points(x: Array, P: Array, rule: Rule) -> Array:
    """The mean and L points to either side along the columns of the Cholesky factor of P, (..., 2 L + 1, L).

    Raises numpy.linalg.LinAlgError when P is not positive definite. Source: (37).
    """
    L = x.shape[-1]
    spread, _, _ = rule.weights(L)
    rows = np.swapaxes(cholesky(P), -1, -2) * np.sqrt(spread)
    points = np.empty((*np.broadcast_shapes(x.shape[:-1], P.shape[:-2]), 2 * L + 1, L))
    points[..., 0, :] = x
    points[..., 1 : L + 1, :] = x[..., None, :] + rows
    points[..., L + 1 :, :] = x[..., None, :] - rows
    return points


def predict(x: Array, P: Array, f: Model, Q: Array, rule: Rule) -> Prediction:
    """Carry a state over one step with the model f and additive noise Q. Errors as in `sigma_points`.

    Source: (37)-(40).
    """
    _, mean, spread = rule.weights(x.shape[-1])
    moved = f(sigma_points(x, P, rule))
    x = mean @ moved
    away = moved - x[..., None, :]
    P = symmetric(np.swapaxes(away, -1, -2) @ (spread[:, None] * away) + Q)
    return Prediction(x, P, sigma_points(x, P, rule) if rule.redraw else moved)


def update(predicted: Prediction, y: Array, h: Model, R: Array, rule: Rule, valid: Mask | None = None) -> Update:
    """Correct a prediction with a measurement.

    `valid` (..., m): a row that is False drops out as if it had been deleted, whatever y and R hold there.
    Raises numpy.linalg.LinAlgError when the innovation's covariance is not positive definite: R must be positive.
    Source: (41)-(47).
    """
    _, mean, spread = rule.weights(predicted.x.shape[-1])
    seen = h(predicted.points)
    expected = mean @ seen
    off = seen - expected[..., None, :]
    nu = y - expected
    m = y.shape[-1]
    full = R if R.ndim == y.ndim + 1 else R[..., None] * np.eye(m)
    if valid is not None:
        nu = np.where(valid, nu, 0.0)
        off = np.where(valid[..., None, :], off, 0.0)
        full = np.where(valid[..., :, None] & valid[..., None, :], full, np.eye(m))
    weighted = spread[:, None] * off
    S = symmetric(np.swapaxes(off, -1, -2) @ weighted + full)
    C = np.swapaxes(predicted.points - predicted.x[..., None, :], -1, -2) @ weighted
    whitener = triangular_inverse(cholesky(S))
    W = whitener @ np.swapaxes(C, -1, -2)
    whitened = np.matvec(whitener, nu)
    dof = np.full(nu.shape[:-1], m) if valid is None else np.broadcast_to(valid.sum(axis=-1), nu.shape[:-1])
    return Update(
        x=predicted.x + np.matvec(np.swapaxes(W, -1, -2), whitened),
        P=predicted.P - np.swapaxes(W, -1, -2) @ W,
        innovation=nu,
        covariance=S,
        gain=np.swapaxes(W, -1, -2) @ whitener,
        statistic=np.asarray(np.vecdot(whitened, whitened)),
        dof=np.asarray(dof),
    )


@lru_cache(maxsize=64)
def _weights(alpha: float, beta: float, kappa: float, L: int) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    spread = alpha**2 * (L + kappa)
    if not spread > 0.0:
        raise ValueError(f"alpha {alpha:g} and kappa {kappa:g} do not spread the points of {L} states")
    mean = np.full(2 * L + 1, 0.5 / spread)
    mean[0] = 1.0 - L / spread
    covariance = mean.copy()
    covariance[0] += 1.0 - alpha**2 + beta
    mean.flags.writeable = covariance.flags.writeable = False
    return spread, mean, covariance
