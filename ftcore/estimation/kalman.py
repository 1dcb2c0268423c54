"""The Kalman filter, for one filter or for a bank of filters in many runs at once.

Shapes. Every array leads with the same leading axes, written `...`: `(runs,)` for one filter, `(runs, bank)` for a
bank. They broadcast: what is common to all runs (or to the whole bank) keeps a 1 there, and stays cheap, because
results take the broadcast shape of what they are made of: with `P`, `H`, `R` of one run and `x`, `y` of a hundred,
the covariance work is done once.

    x (..., n) state          P (..., n, n) its covariance      Phi (..., n, n) transition    Q (..., n, n) its noise
    y (..., m) measurement    H (..., m, n) its matrix          R (..., m) variances or (..., m, m) covariance

Conventions. Error = estimated - true. Units are the caller's. Nothing given is changed in place.
Sources: H.G. Zhang and H.Y. Zhang (1992), equations (4)-(8); the whitened form is G.J. Bierman, Factorization Methods
for Discrete Sequential Estimation (1977), and R.E. Kalman (1960) before both.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

_LOG_2PI = float(np.log(2.0 * np.pi))
_CORNER = 1e300
"""Larger than any e' P^-1 e, so that a matrix bordered by e and this stays positive definite."""
_FEW_ROWS = 400
"""Below this many matrix rows in a stack, one LAPACK call is quicker than a recursion of NumPy calls (measured)."""
_SOUND = 1e-8
"""Least eigenvalue of a covariance of unit diagonal that was mended."""
_LEAF = 5
"""So small a triangular matrix is inverted entry by entry."""


@dataclass(frozen=True, slots=True)
class Innovation:
    """A measurement against its prediction, made unit and independent by the Cholesky factor `S = L L'`.

    A row that is not valid has innovation 0 and the unit row in `covariance` and `whitener`: it adds nothing.
    """

    innovation: Array
    """nu = y - H x, (..., m), measurement units."""
    covariance: Array
    """S = H P H' + R, (..., m, m)."""
    whitener: Array
    """L^-1, (..., m, m), lower triangular: turns anything in measurement units into unit, independent numbers."""
    whitened: Array
    """L^-1 nu, (..., m): standard normal while the model holds."""
    dof: Ints
    """Valid rows, (...): the degrees of freedom of `statistic`."""

    @property
    def statistic(self) -> Array:
        """nu' S^-1 nu, (...): chi-square on `dof` while the model holds; equation (56) of Zhang and Zhang (1992)."""
        return np.asarray(np.vecdot(self.whitened, self.whitened))

    @property
    def log_likelihood(self) -> Array:
        """Logarithm of the Gaussian density of the valid rows, (...); 0 where no row is valid."""
        log_det = -2.0 * np.log(np.diagonal(self.whitener, axis1=-2, axis2=-1)).sum(axis=-1)
        return np.asarray(-0.5 * (self.statistic + log_det + self.dof * _LOG_2PI))


@dataclass(frozen=True, slots=True)
class Update(Innovation):
    """The estimate after a measurement, with the innovation that led to it."""

    x: Array
    """Updated state, (..., n)."""
    P: Array
    """Updated covariance, (..., n, n), exactly symmetric when the prior was."""
    reach: Array
    """W = L^-1 H P, (..., m, n): the update took W' W away from P."""

    @property
    def gain(self) -> Array:
        """K = W' L^-1, (..., n, m); its columns at rows that are not valid are 0."""
        return np.asarray(self.reach.swapaxes(-1, -2) @ self.whitener)


def predict(x: Array, P: Array, Phi: Array, Q: Array) -> tuple[Array, Array]:
    """Carry a state and its covariance over one step: `x <- Phi x`, `P <- Phi P Phi' + Q`.

    Shapes: x (..., n), P, Phi and Q (..., n, n), broadcasting; so a bank x (runs, bank, n) goes with Phi
    (runs, 1, n, n) and Q (runs, bank, n, n). Returns x and P; P is exactly symmetric.
    Q has to be symmetric. Source: (5) and (7) of Zhang and Zhang (1992), Q standing for G Q G'.
    """
    half = Phi @ P @ np.multiply(Phi.swapaxes(-1, -2), 0.5, order="C")
    carried = half + half.swapaxes(-1, -2)
    return np.matvec(Phi, x), np.add(carried, Q, out=carried if carried.shape == Q.shape else None)


def innovation(x: Array, P: Array, y: Array, H: Array, R: Array, valid: Mask | None = None) -> Innovation:
    """Compare a measurement with its prediction, without touching the estimate.

    Shapes: x (..., n), P (..., n, n), y (..., m), H (..., m, n); R (..., m) variances, or (..., m, m) when it has one
    axis more than y. `valid` (..., m): a row that is False drops out exactly as if it had been deleted, whatever y, H
    and R hold there (NaN too). Raises `numpy.linalg.LinAlgError` when S is not positive definite: R must be positive.
    Source: (53)-(55) of Zhang and Zhang (1992).
    """
    return _innovation(x, P, y, H, R, valid)[0]


def update(x: Array, P: Array, y: Array, H: Array, R: Array, valid: Mask | None = None, joseph: bool = False) -> Update:
    """Correct a state with a measurement.

    Shapes, `valid` and errors as in `innovation`. With W = L^-1 H P, the gain is K = W' L^-1 and the covariance
    P - W' W, which is symmetric by construction and equal to (8). `joseph` asks for the longer form
    (I - K H) P (I - K H)' + K R K', for priors so much wider than R that P - W' W cancels (beyond about 1e12).
    Source: (4), (6) and (8) of Zhang and Zhang (1992).
    """
    inn, HP, H, R = _innovation(x, P, y, H, R, valid)
    W = inn.whitener @ HP
    if joseph:
        K = W.swapaxes(-1, -2) @ inn.whitener
        I_KH = identity(P.shape[-1]) - K @ H
        P_new = symmetric(I_KH @ P @ _transposed(I_KH) + K @ R @ _transposed(K))
    else:
        lost = W.swapaxes(-1, -2) @ W  # NumPy sees a matrix and its own transpose: symmetric to the bit
        P_new = np.subtract(P, lost, out=lost if lost.shape == P.shape else None)
    return Update(
        innovation=inn.innovation,
        covariance=inn.covariance,
        whitener=inn.whitener,
        whitened=inn.whitened,
        dof=inn.dof,
        x=x + np.vecmat(inn.whitened, W),
        P=P_new,
        reach=W,
    )


def nees(error: Array, P: Array) -> Array:
    """Normalised estimation error squared, e' P^-1 e: chi-square on n while P tells the truth.

    Shapes: error (..., n), P (..., n, n); returns (...), NaN where the error is not finite. P is brought to unit
    diagonal first, so states may differ in units by many orders. Raises `numpy.linalg.LinAlgError` when P is not
    positive definite.
    Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 5.4.
    """
    n = P.shape[-1]
    scale = 1.0 / np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
    known = np.asarray(np.isfinite(error).all(axis=-1))
    # Below the factor L of P, that of [P e; e' c] has the row (L^-1 e)', whatever c is: no inverse is needed.
    bordered = np.empty((*np.broadcast_shapes(P.shape[:-2], error.shape[:-1]), n + 1, n + 1))
    np.multiply(P, scale[..., :, None] * scale[..., None, :], out=bordered[..., :n, :n])
    bordered[..., n, :n] = bordered[..., :n, n] = np.where(known[..., None], error * scale, 0.0)
    bordered[..., n, n] = _CORNER
    whitened = cholesky(bordered)[..., n, :n]
    return np.where(known, np.vecdot(whitened, whitened), np.nan)


def nis(inn: Innovation) -> Array:
    """Normalised innovation squared of an innovation or an update, (...): chi-square on `inn.dof`."""
    return inn.statistic


def consistency_band(dof: float, samples: int, confidence: float = 0.95) -> tuple[float, float]:
    """Two-sided band for the mean of `samples` independent NEES or NIS values on `dof` degrees of freedom.

    Raises ValueError for a confidence outside (0, 1) or for no samples. Source: as `nees`.
    """
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence must lie between 0 and 1, not {confidence}")
    if samples < 1 or dof <= 0:
        raise ValueError(f"a band needs at least one sample and positive dof, not {samples} and {dof}")
    low, high = chi2.ppf([0.5 * (1.0 - confidence), 0.5 * (1.0 + confidence)], dof * samples) / samples
    return float(low), float(high)


def symmetric(A: Array) -> Array:
    """Symmetric part of square matrices, (..., n, n): exact symmetry, which rounding in Phi P Phi' loses."""
    S = A + A.swapaxes(-1, -2)
    S *= 0.5
    return S


@lru_cache(maxsize=64)
def identity(n: int) -> Array:
    """The unit matrix, (n, n), read only: made once."""
    eye = np.eye(n)
    eye.flags.writeable = False
    return eye


def sound(P: Array) -> Array:
    """Covariances (..., n, n), those that rounding has made indefinite replaced by the nearest ones that are not.

    An innovation of thousands of sigma leaves a spread between models that is 1e13 times what they know; the update
    after it takes that away again, and what remains is rounding. Such a matrix is brought to unit diagonal, and its
    eigenvalues to `_SOUND` at least: what it says of those directions is lost, and they are known no better than that.
    Sound ones come back as they are, to the bit, and so do those with a number that is not finite.
    """
    try:
        np.linalg.cholesky(P)
        return P
    except np.linalg.LinAlgError:
        pass
    n = P.shape[-1]
    mended = P.reshape(-1, n, n).copy()
    for i, matrix in enumerate(mended):
        if not np.isfinite(matrix).all():
            continue
        variance = np.abs(np.diagonal(matrix))
        scale = np.sqrt(np.maximum(variance, np.finfo(float).tiny))
        values, V = np.linalg.eigh(symmetric(matrix / (scale[:, None] * scale)))
        if values[0] < _SOUND:
            mended[i] = symmetric((V * np.maximum(values, _SOUND)) @ V.T) * (scale[:, None] * scale)
    return mended.reshape(P.shape)


def cholesky(A: Array) -> Array:
    """Lower triangular L with L L' = A, (..., n, n); LinAlgError names the places that are not positive definite."""
    try:
        return np.asarray(np.linalg.cholesky(A))
    except np.linalg.LinAlgError:
        smallest = np.linalg.eigvalsh(A)[..., 0] if np.isfinite(A).all() else np.full(A.shape[:-2], np.nan)
        where = np.argwhere(~(smallest > 0.0)).tolist()
        raise np.linalg.LinAlgError(
            f"not positive definite: the matrix at {where[:5]} of {A.shape[:-2]} "
            f"(smallest eigenvalue {np.min(smallest):g}); check that R, Q and P hold positive variances"
        ) from None


def triangular_inverse(L: Array) -> Array:
    """Inverse of lower triangular matrices, (..., m, m); raises LinAlgError or gives inf for a zero diagonal.

    NumPy has no batched triangular solve. A large stack is halved as blocks, [A 0; B C]^-1 = [A^-1 0; -C^-1 B A^-1
    C^-1], with as many NumPy calls for a thousand matrices as for one; a small one goes to LAPACK.
    Stability: J.J. Du Croz and N.J. Higham, Stability of methods for matrix inversion (1992), method 2C.
    """
    m = L.shape[-1]
    if L.size <= _FEW_ROWS * m:
        return np.asarray(np.linalg.inv(L), dtype=np.float64)
    inverse = np.zeros_like(L)
    _invert_triangular(L, inverse)
    return inverse


def spd_inverse(P: Array) -> Array:
    """Inverse of symmetric positive definite matrices, (..., n, n); raises LinAlgError when one is not.

    The diagonal should have been scaled to order one: Cholesky's error then depends on the correlation only.
    """
    L_inv = triangular_inverse(cholesky(P))
    inverse: Array = L_inv.swapaxes(-1, -2) @ L_inv
    return inverse


def _innovation(
    x: Array, P: Array, y: Array, H: Array, R: Array, valid: Mask | None
) -> tuple[Innovation, Array, Array, Array]:
    """The innovation, with H P and the masked H and full R that made it."""
    m = H.shape[-2]
    full = R.ndim == y.ndim + 1
    if valid is not None and valid.all():
        valid = None
    if valid is not None:
        y = np.where(valid, y, 0.0)
        H = np.where(valid[..., None], H, 0.0)
        R = np.where(valid[..., :, None] & valid[..., None, :], R, identity(m)) if full else np.where(valid, R, 1.0)
    if not full:
        R = R[..., None] * identity(m)
    HP = H @ P
    S = HP @ _transposed(H) + R
    whitener = triangular_inverse(cholesky(S))
    nu = y - np.matvec(H, x)
    dof = np.full(nu.shape[:-1], m) if valid is None else np.count_nonzero(valid, axis=-1)
    return Innovation(nu, S, whitener, np.matvec(whitener, nu), np.asarray(dof)), HP, H, R


def _transposed(A: Array) -> Array:
    """The transpose laid out anew: BLAS multiplies a small transposed view at half the speed, a copy is cheaper."""
    return np.ascontiguousarray(A.swapaxes(-1, -2))


def _invert_triangular(L: Array, inverse: Array) -> None:
    """Write the inverses of L (..., m, m) into `inverse`, which holds zeros; both may be views into larger matrices."""
    m = L.shape[-1]
    if m <= _LEAF:
        _substitute(L, inverse)
        return
    h = m // 2
    if m % 2:
        _invert_triangular(L[..., :h, :h], inverse[..., :h, :h])
        _invert_triangular(L[..., h:, h:], inverse[..., h:, h:])
    else:
        _invert_triangular(_halves(L), _halves(inverse))
    upper, lower = inverse[..., :h, :h], inverse[..., h:, h:]
    np.negative(lower @ (L[..., h:, :h] @ upper), out=inverse[..., h:, :h])


def _halves(A: Array) -> Array:
    """Upper left and lower right quarter of matrices of even size (..., m, m): a view (..., 2, m/2, m/2)."""
    h = A.shape[-1] // 2
    view: Array = np.einsum("...pipj->...pij", A.reshape(*A.shape[:-2], 2, h, 2, h))
    return view


def _substitute(L: Array, inverse: Array) -> None:
    """The same for a few rows, entry by entry: of matrices so small a product costs more to call than to compute."""
    for i in range(L.shape[-1]):
        diagonal = 1.0 / L[..., i, i]
        inverse[..., i, i] = diagonal
        for j in range(i):
            total = L[..., i, j] * inverse[..., j, j]
            for between in range(j + 1, i):
                total += L[..., i, between] * inverse[..., between, j]
            np.multiply(total, -diagonal, out=inverse[..., i, j])
