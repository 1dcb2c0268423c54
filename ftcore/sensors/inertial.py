"""Redundant inertial measurement unit: any set of input axes, sampled faster than the epoch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore.noise import NoiseSource
from ftcore.readings import Group

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AxisCluster:
    """All input axes of one quantity (angular rate or specific force).

    Attributes:
        name: reading group, for instance ``imu.gyro``.
        axes: ``(k, 3)`` unit input axes in the body frame.
        bias: ``(runs, k)`` repeatability drawn for each run, constant in flight [SI].
        density: white noise density [SI per square root of Hz].
        noise: address space of the randomness.
        scale: ``(runs, k)`` scale-factor errors drawn for each run, constant in flight [1]; None where there are none.
    """

    name: str
    axes: Array
    bias: Array
    density: float
    noise: NoiseSource
    scale: Array | None = None

    @classmethod
    def drawn(
        cls,
        name: str,
        axes: Array,
        bias_sigma: float,
        density: float,
        noise: NoiseSource,
        scale_sigma: float = 0.0,
    ) -> AxisCluster:
        """A cluster whose axis biases and scale-factor errors are drawn once per run with these 1-sigmas."""
        bias = bias_sigma * noise.normal(f"{name}.bias", 0, (len(axes),))
        scale = scale_sigma * noise.normal(f"{name}.scale", 0, (len(axes),)) if scale_sigma else None
        return cls(name, axes, bias, density, noise, scale)

    def sense(self, truth_b: Array, epoch: int, times: Array, dt: float) -> Group:
        """Readings of one epoch.

        Args:
            truth_b: ``(1 or runs, samples, 3)`` true mean of the quantity over each sample interval, body frame.
            epoch: address of the noise.
            times: ``(samples,)`` of the samples [s].
            dt: sample interval [s].

        Returns:
            ``(runs, k, samples)`` readings.
        """
        exact = np.swapaxes(truth_b @ self.axes.T, -1, -2)
        if self.scale is not None:
            exact = exact * (1.0 + self.scale[..., None])
        white = self.noise.normal(self.name, epoch, exact.shape[-2:])
        values = exact + self.bias[..., None] + (self.density / math.sqrt(dt)) * white
        return Group(values, np.ones((1, len(self.axes)), bool), times)

    def calibrate(self, truth_b: Array, seconds: float) -> Array:
        """Mean reading ``(runs, k)`` over a pre-flight standstill of ``seconds`` with ``truth_b (3,)`` applied."""
        white = self.noise.normal(f"{self.name}.calibration", 0, (len(self.axes),))
        gain = 1.0 if self.scale is None else 1.0 + self.scale
        mean: Array = (self.axes @ truth_b) * gain + self.bias + self.density / math.sqrt(seconds) * white
        return mean
