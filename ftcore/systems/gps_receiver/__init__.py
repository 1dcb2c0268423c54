"""System B: integrity of a GPS receiver by snapshot, filter and both combined (Chey, Jee and Lee, ICCAS 2004)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ftcore.noise import NoiseSource
from ftcore.systems.base import Assembly, Remark
from ftcore.systems.gps_receiver.description import description
from ftcore.systems.gps_receiver.forms import Parameters, Settings
from ftcore.systems.gps_receiver.names import EPOCH, PRNS, SATELLITES, SUBJECTS, TESTS


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
        from ftcore.systems.gps_receiver.audit import audit
        from ftcore.systems.gps_receiver.navigator import Navigator
        from ftcore.systems.gps_receiver.plant import LogPlant, SimulatedPlant, reference
        from ftcore.systems.gps_receiver.reporter import Reporter

        p: Parameters = parameters
        if p.log is None:
            absent = _absent(PRNS, "it is a satellite of a receiver's log; the simulated receiver sees slots A1 to F4")
            plant: Any = SimulatedPlant(p, noise)
            navigator = Navigator(p, len(runs), EPOCH)
            return Assembly(plant, navigator, Reporter(), TESTS, SUBJECTS, absent=absent, visible=plant.visible)
        log = rinex.read(p.log.observation, p.log.navigation)
        dt = log.interval
        plant = LogPlant(log, p.log, len(runs), p.mask)
        x, y, z = reference(log, p.log).tolist()
        remarks = [*(Remark("log.reading", "gps", note) for note in log.notes), *audit(log, p, (x, y, z))]
        seen = [prn for prn, ranges in zip(PRNS, log.pseudorange.T, strict=True) if np.isfinite(ranges).any()]
        absent = _absent(set(SATELLITES) - set(seen), f"the log has no pseudorange of it; it has {', '.join(seen)}")
        navigator = Navigator(p, len(runs), dt)
        return Assembly(
            plant,
            navigator,
            Reporter(),
            TESTS,
            SUBJECTS,
            dt,
            len(log),
            absent,
            visible=plant.visible,
            remarks=remarks,
        )

    def log_scenario(
        self,
        observation: str,
        navigation: str,
        antenna: tuple[float, float, float] | None,
        max_epochs: int,
        noise_floor: float | None,
    ) -> dict[str, Any]:
        """See :func:`ftcore.systems.gps_receiver.logs.log_scenario`."""
        from ftcore.systems.gps_receiver.logs import log_scenario

        return log_scenario(observation, navigation, antenna, max_epochs, noise_floor)


def _absent(satellites: Iterable[str], reason: str) -> dict[str, str]:
    """Channels of these satellites, with the reason."""
    return {f"gps.pseudorange.{name}": reason for name in sorted(satellites)}
