"""System A: SINS/GPS/Doppler federated system with chi-square FDI (Zhang and Zhang, ICAS 1992)."""

from __future__ import annotations

from typing import Any

from ftcore.description import Indicator
from ftcore.noise import NoiseSource
from ftcore.systems.base import Assembly
from ftcore.systems.sins_gps_doppler.description import description
from ftcore.systems.sins_gps_doppler.forms import Parameters, Settings
from ftcore.systems.sins_gps_doppler.names import SUBJECTS, TESTS


class SinsGpsDoppler:
    """See :class:`ftcore.systems.base.System`."""

    description = description()
    Parameters = Parameters
    Settings = Settings

    def indicators(self, parameters: Any, settings: Any) -> tuple[Indicator, ...]:
        """What the mounting of the redundant IMU is good for; gyros and accelerometers are mounted alike."""
        from ftcore.systems.mounting import mounting_indicators
        from ftcore.systems.sins_gps_doppler.navigator import Navigator

        return mounting_indicators(Navigator.geometry(parameters), "inertial.mounting")

    def assemble(self, parameters: Any, duration: float, runs: range, noise: NoiseSource) -> Assembly:
        """Put the system together for ``duration`` seconds."""
        from ftcore.systems.sins_gps_doppler.navigator import Navigator
        from ftcore.systems.sins_gps_doppler.plant import Plant
        from ftcore.systems.sins_gps_doppler.reporter import Reporter

        cluster = Navigator.geometry(parameters)
        plant = Plant(parameters, cluster.H, duration, noise)
        navigator = Navigator(parameters, cluster, len(runs), plant.alignment(), plant.calibration())
        return Assembly(plant, navigator, Reporter(cluster), TESTS, SUBJECTS, visible=plant.visible)
