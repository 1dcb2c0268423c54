"""System C: SINS/GPS/BD2/CNS with IMM, two state propagators and tolerant fusion (Yang et al., Sensors 2016)."""

from __future__ import annotations

from typing import Any

from ftcore.noise import NoiseSource
from ftcore.systems.base import Assembly
from ftcore.systems.sins_gps_bd2_cns.description import description
from ftcore.systems.sins_gps_bd2_cns.forms import Parameters, Settings
from ftcore.systems.sins_gps_bd2_cns.names import BODY, CLUSTERS, PAIRS, SUBJECTS, TESTS


class SinsGpsBd2Cns:
    """See :class:`ftcore.systems.base.System`."""

    description = description()
    Parameters = Parameters
    Settings = Settings

    def assemble(self, parameters: Any, duration: float, runs: range, noise: NoiseSource) -> Assembly:
        """Put the system together for ``duration`` seconds. Raises ValueError for a path that cannot be flown."""
        from ftcore.systems.sins_gps_bd2_cns.imu import input_axes
        from ftcore.systems.sins_gps_bd2_cns.navigator import Navigator
        from ftcore.systems.sins_gps_bd2_cns.plant import Plant
        from ftcore.systems.sins_gps_bd2_cns.reporter import Reporter
        from ftcore.systems.sins_gps_bd2_cns.sky import Sky

        p: Parameters = parameters
        axes = input_axes(p)
        plant = Plant(p, axes, duration, noise)
        navigator = Navigator(p, plant.chart, len(runs), plant.alignment(), plant.calibration())
        reporter = Reporter(axes, Sky(p.aiding))
        return Assembly(plant, navigator, reporter, TESTS, SUBJECTS, absent=_absent(p))


def _absent(p: Parameters) -> dict[str, str]:
    """Channels of the IMU that is not fitted."""
    fitted = p.inertial.configuration
    other, axes = {"three-axis": ("redundant", PAIRS), "redundant": ("three-axis", BODY)}[fitted]
    reason = f"the {fitted} IMU is fitted; parameter inertial.configuration = {other!r} brings this channel"
    return {f"imu.{cluster}.{axis}": reason for cluster in CLUSTERS for axis in axes}
