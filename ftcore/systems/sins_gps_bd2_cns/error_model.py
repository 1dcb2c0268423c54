"""The error model of the strapdown that all filters of the SINS/GPS/BD2/CNS system share: Yang 2016 (1)-(4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore import units
from ftcore.estimation import ins_error
from ftcore.systems.sins_gps_bd2_cns.forms import EPOCH, Parameters
from ftcore.systems.sins_gps_bd2_cns.imu import Imu

Array = NDArray[np.float64]
N = ins_error.CORE_STATES
DECAYING = np.arange(9, 15)


@dataclass(frozen=True)
class Flown:
    """What the model needs to know of an epoch: means over it; leading axis runs, or runs times solutions.

    Attributes:
        lla, v_n, f_n, C_nb: see :class:`ftcore.estimation.strapdown.Interval`.
        noise: body noise covariance density of gyros and accelerometers, ``(runs or 1, S, 2, 3, 3)``.
    """

    lla: Array
    v_n: Array
    f_n: Array
    C_nb: Array
    noise: Array

    def protected(self, runs: int) -> Flown:
        """Of the first solution alone."""
        lla, v_n, f_n, C_nb = (
            a.reshape(runs, -1, *a.shape[1:])[:, 0] for a in (self.lla, self.v_n, self.f_n, self.C_nb)
        )
        return Flown(lla, v_n, f_n, C_nb, self.noise[:, :1])


class ErrorModel:
    """Transition and process noise of an epoch, and the covariance at the start."""

    def __init__(self, p: Parameters, imu: Imu) -> None:
        self._p = p
        self._imu = imu
        m = p.models
        self._scale = np.array([1.0, m.ratio])
        # The axes of the plain IMU are alike: its noise looks the same from any frame.
        self._plain = self._spectrum(imu.noise[0]) if imu.solutions == 1 else None

    def matrices(self, flown: Flown) -> tuple[Array, Array]:
        """Phi ``(runs, S, 15, 15)`` and Q ``(runs, S, 2, 15, 15)`` of both models."""
        F = ins_error.core_matrix(flown.lla, flown.v_n, flown.f_n, flown.C_nb)
        F[:, DECAYING, DECAYING] = -1.0 / self._p.models.bias_time
        Phi = ins_error.transition(F, EPOCH)
        Q = ins_error.process_noise(F, self._density(flown), EPOCH)
        shape = (-1, flown.noise.shape[1], N, N)
        return Phi.reshape(shape), Q.reshape(shape)[:, :, None] * self._scale[:, None, None]

    def initial_covariance(self) -> Array:
        """P(0) ``(15, 15)``: alignment and repeatability of the sensors."""
        n = self._p.initial
        sigma = np.array([n.position] * 3 + [n.velocity] * 3 + [n.tilt, n.tilt, n.azimuth] + [0.0] * 6)
        # A state that is known exactly keeps a hair of variance, so that every covariance has an inverse.
        floor = np.array([1e-6] * 9 + [1e-12] * 3 + [1e-9] * 3)
        P0 = np.diag(np.maximum(sigma, floor) ** 2)
        body = self._imu.bias_covariance()
        P0[ins_error.GYRO, ins_error.GYRO] += body[0]
        start = units.to_si(self._p.models.accelerometer_start, "ug") / max(self._imu.bias[1], 1e-12)
        P0[ins_error.ACCELEROMETER, ins_error.ACCELEROMETER] += start**2 * body[1]
        return P0

    def _density(self, flown: Flown) -> Array:
        """Spectral density ``(runs S or 1, 15, 15)`` of Q_small: white noise of the IMU, and what drives its biases."""
        if self._plain is not None:
            return self._plain
        C = flown.C_nb[:, None]
        return self._spectrum(C @ flown.noise.reshape(-1, 2, 3, 3) @ C.swapaxes(-1, -2))

    def _spectrum(self, level: Array) -> Array:
        """The same from the white noise of gyros and accelerometers in the level frame, ``(..., 2, 3, 3)``."""
        m = self._p.models
        Qc = np.zeros((*level.shape[:-3], N, N))
        Qc[..., ins_error.ATTITUDE, ins_error.ATTITUDE] = m.noise_scale * level[..., 0, :, :]
        Qc[..., ins_error.VELOCITY, ins_error.VELOCITY] = m.noise_scale * level[..., 1, :, :]
        walk = m.noise_scale * m.bias_instability**2 * 2.0 / m.bias_time * self._imu.bias_covariance()
        Qc[..., ins_error.GYRO, ins_error.GYRO] = walk[0]
        Qc[..., ins_error.ACCELEROMETER, ins_error.ACCELEROMETER] = walk[1]
        return Qc
