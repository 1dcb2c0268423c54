"""System B: integrity of a GPS receiver by snapshot, filter and both combined (Chey, Jee and Lee, ICCAS 2004)."""

from __future__ import annotations

from typing import Any

from ftcore.noise import NoiseSource
from ftcore.systems.base import Assembly
from ftcore.systems.gps_receiver.description import description
from ftcore.systems.gps_receiver.forms import Parameters, Settings
from ftcore.systems.gps_receiver.names import EPOCH, SUBJECTS, TESTS


class GpsReceiver:
    """See :class:`ftcore.systems.base.System`."""

    description = description()
    Parameters = Parameters
    Settings = Settings

    def assemble(self, parameters: Any, duration: float, runs: range, noise: NoiseSource) -> Assembly:
        """Put the system together for ``duration`` seconds.

        Raises:
            LogError: the scenario asks for a log that cannot be used; a ValueError of one sentence.
        """
        from ftcore.sensors import rinex
        from ftcore.systems.gps_receiver.navigator import Navigator
        from ftcore.systems.gps_receiver.plant import LogPlant, SimulatedPlant
        from ftcore.systems.gps_receiver.reporter import Reporter

        p: Parameters = parameters
        if p.log is None:
            return Assembly(SimulatedPlant(p, noise), Navigator(p, len(runs), EPOCH), Reporter(), TESTS, SUBJECTS)
        log = rinex.read(p.log.observation, p.log.navigation)
        dt = log.interval
        plant = LogPlant(log, p.log, len(runs))
        return Assembly(plant, Navigator(p, len(runs), dt), Reporter(), TESTS, SUBJECTS, period=dt, epochs=len(log))

    def log_scenario(
        self, observation: str, navigation: str, antenna: tuple[float, float, float] | None, max_epochs: int
    ) -> dict[str, Any]:
        """See :func:`ftcore.systems.gps_receiver.logs.log_scenario`."""
        from ftcore.systems.gps_receiver.logs import log_scenario

        return log_scenario(observation, navigation, antenna, max_epochs)
