"""System B: integrity of a GPS receiver by snapshot, filter and both combined (Chey, Jee and Lee, ICCAS 2004)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ftcore.noise import NoiseSource
from ftcore.parts.declared import describe
from ftcore.parts.ledger import Layout, Ledger
from ftcore.systems.base import Assembly, Remark
from ftcore.systems.gps_receiver import combination, estimators, innovations, integrity, satellites, snapshot
from ftcore.systems.gps_receiver.forms import Parameters, Settings
from ftcore.systems.gps_receiver.satellites import EPOCH, PRNS, SATELLITES
from ftcore.systems.reporting import Reporter

PARTS = (satellites, snapshot, innovations, combination, estimators, integrity)
DECLARED = sum((part.DECLARED for part in PARTS[1:]), satellites.DECLARED)
LAYOUT = Layout(DECLARED)


def _errors(truth: estimators.Truth, say: Ledger) -> None:
    """What follows from truth."""
    estimators.errors(truth, say)
    integrity.classify(say)


class GpsReceiver:
    """See :class:`ftcore.systems.base.System`."""

    description = describe(
        DECLARED,
        id="gps-receiver",
        title="GPS receiver with integrity",
        summary=(
            "A standing GPS receiver, simulated or from a real log, whose faulty satellites are found by a snapshot "
            "test, by a filter, and by both combined, with the error that could hide."
        ),
        source="J. Chey, G.-I. Jee and J.G. Lee, Combining approach in FDI for GPS applications, ICCAS 2004",
        epoch=EPOCH,
        estimators={name: name for name in estimators.ESTIMATORS},
        shown=("position-horizontal", "sky", "residual-bars", "stanford-combined", "snapshot", "innovation"),
        settings_schema=Settings.model_json_schema(),
        parameters_schema=Parameters.model_json_schema(),
        score_headline=("combined.error.position.horizontal", "unprotected.error.position.horizontal"),
    )
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

        p: Parameters = parameters
        reporter = Reporter(self.description, LAYOUT, _errors, [part.blocks for part in PARTS])
        if p.log is None:
            absent = _absent(PRNS, "it is a satellite of a receiver's log; the simulated receiver sees slots A1 to F4")
            plant: Any = SimulatedPlant(p, noise)
            navigator = Navigator(p, len(runs), EPOCH, LAYOUT)
            return Assembly(
                plant, navigator, reporter, LAYOUT.tests, LAYOUT.subjects, absent=absent, visible=plant.visible
            )
        log = rinex.read(p.log.observation, p.log.navigation)
        dt = log.interval
        plant = LogPlant(log, p.log, len(runs), p.mask)
        x, y, z = reference(log, p.log).tolist()
        remarks = [*(Remark("log.reading", "gps", note) for note in log.notes), *audit(log, p, (x, y, z))]
        seen = [prn for prn, ranges in zip(PRNS, log.pseudorange.T, strict=True) if np.isfinite(ranges).any()]
        absent = _absent(set(SATELLITES) - set(seen), f"the log has no pseudorange of it; it has {', '.join(seen)}")
        navigator = Navigator(p, len(runs), dt, LAYOUT)
        return Assembly(
            plant,
            navigator,
            reporter,
            LAYOUT.tests,
            LAYOUT.subjects,
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
