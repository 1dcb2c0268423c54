"""The two strapdowns of the SINS/GPS/Doppler system over one epoch, and what a filter has to know of it.

The protected one flies with the trusted instruments of the redundant IMU, the unprotected one with all there are. An
epoch has two parts: free inertial flight (`fly`), and then the vertical channel is pulled towards the altimeter, if
that is trusted (`damp`). Between the two the altimeter is judged, so a reading that is found wrong never enters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ftcore.estimation import ins_error
from ftcore.estimation.strapdown import InsState, Interval, damp_vertical, propagate
from ftcore.readings import Readings
from ftcore.systems.base import Flags
from ftcore.systems.sins_gps_doppler.forms import EPOCH, Aiding
from ftcore.systems.sins_gps_doppler.imu import ImuEpoch

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Free inertial flight of one epoch: the interval ``(2 runs,)``, run-major, and the body noise of its instruments
    ``(runs, 2, 2, 3, 3)``; see :class:`ImuEpoch`."""

    interval: Interval
    noise: Array


@dataclass(frozen=True)
class Damping:
    """The altimeter in one epoch.

    Attributes:
        height: ``(runs,)`` what it reads [m], 0 without a reading.
        above: ``(runs, 2)`` height of the protected and the unprotected strapdown minus the reading [m].
        present: ``(runs,)`` whether there is a reading, and the altimeter is switched on.
        gains: ``(runs, 2, 2)`` of each strapdown, by which a metre of ``above`` moves height [1] and vertical velocity
            [1/s] downwards; 0 where the reading is not taken.
    """

    height: Array
    above: Array
    present: Flags
    gains: Array

    def trusted(self, protected: Flags, gains: tuple[float, float]) -> Damping:
        """The same, taken by the protected strapdown where ``protected (runs,)``, by the unprotected one anyway."""
        on = np.stack([self.present & protected, self.present], axis=-1)
        return replace(self, gains=on[..., None] * (np.array(gains) * EPOCH))


def fly(ins: InsState, imu: ImuEpoch) -> tuple[InsState, Motion]:
    """Both strapdowns over one epoch, not yet damped; ``ins`` leads with ``(2 runs,)``."""
    runs, _, samples = imu.omega_b.shape[:3]
    omega_b, f_b = imu.omega_b.reshape(2 * runs, samples, 3), imu.f_b.reshape(2 * runs, samples, 3)
    ins, interval = propagate(ins, omega_b, f_b, EPOCH / samples)
    return ins, Motion(interval, imu.noise)


def matrices(motion: Motion, a: Aiding) -> tuple[Array, Array]:
    """Transition and noise of the free flight, ``(runs, 2, 21, 21)`` each."""
    noise = motion.noise.reshape(-1, 2, 3, 3)
    densities = ins_error.NoiseDensities(
        gyro=noise[:, 0],
        accelerometer=noise[:, 1],
        clock_phase=a.clock_phase_noise,
        clock_frequency=a.clock_frequency_noise,
    )
    F = ins_error.system_matrix(motion.interval)
    Phi = ins_error.transition(F, EPOCH)
    Q = ins_error.process_noise(F, ins_error.noise_density(motion.interval, densities), EPOCH)
    shape = (len(motion.noise), 2, ins_error.STATES, ins_error.STATES)
    return Phi.reshape(shape), Q.reshape(shape)


def altimeter(ins: InsState, readings: Readings, enabled: bool) -> Damping:
    """What the altimeter reads against both strapdowns; not trusted yet."""
    group = readings["altimeter.height"]
    runs = len(ins.lla) // 2
    height = np.broadcast_to(np.where(np.isfinite(group.values[:, 0]), group.values[:, 0], 0.0), (runs,))
    present = np.broadcast_to(group.valid[:, 0] & np.isfinite(group.values[:, 0]) & enabled, (runs,))
    above = ins.lla[:, 2].reshape(runs, 2) - height[:, None]
    return Damping(height, above, np.asarray(present), np.zeros((runs, 2, 2)))


def damp(ins: InsState, damping: Damping) -> InsState:
    """Pull the vertical channels towards the altimeter where it is trusted."""
    k1, k2 = np.moveaxis(damping.gains.reshape(-1, 2), -1, 0) / EPOCH
    return damp_vertical(ins, np.repeat(damping.height, 2), EPOCH, k1, k2)


def damped(Phi: Array, damping: Damping) -> Array:
    """Transition ``(runs, 21, 21)`` of the protected strapdown's whole epoch, from that of its free flight."""
    k1, k2 = damping.gains[:, 0, 0] / EPOCH, damping.gains[:, 0, 1] / EPOCH
    whole: Array = ins_error.damping_transition(damping.height, EPOCH, k1, k2) @ Phi
    return whole
