"""System A: SINS/GPS/Doppler federated system with chi-square FDI (Zhang and Zhang, ICAS 1992)."""

from __future__ import annotations

from typing import Any

from ftcore.description import Indicator
from ftcore.noise import NoiseSource
from ftcore.parts.declared import Declared, describe
from ftcore.parts.ledger import Layout
from ftcore.systems.base import Assembly
from ftcore.systems.sins_gps_doppler import (
    aid_tests,
    aids,
    altimeter,
    diagram,
    estimators,
    inertial,
    masters,
    satellites,
)
from ftcore.systems.sins_gps_doppler.forms import EPOCH, Parameters, Settings

PARTS = (estimators, aid_tests, inertial, aids, satellites, altimeter, masters, diagram)
DECLARED = sum((part.DECLARED for part in PARTS), Declared())
LAYOUT = Layout(DECLARED)


class SinsGpsDoppler:
    """See :class:`ftcore.systems.base.System`."""

    description = describe(
        DECLARED,
        id="sins-gps-doppler",
        title="SINS/GPS/Doppler federated system",
        summary=(
            "A strapdown inertial system with a redundant IMU, aided by GPS and Doppler radar through two local "
            "filters and a fault-tolerant master."
        ),
        source="H.G. Zhang and H.Y. Zhang, Fault tolerant scheme for multisensor navigation system, ICAS 1992",
        epoch=EPOCH,
        estimators=estimators.ESTIMATORS,
        shown=("position-up", "velocity-east", "residual-aids", "state-aids", "parity-imu.accelerometer"),
        settings_schema=Settings.model_json_schema(),
        parameters_schema=Parameters.model_json_schema(),
        score_headline=("fused.error.position.up", "unprotected.error.position.up"),
        score_label="Worst altitude error",
    )
    Parameters = Parameters
    Settings = Settings

    def indicators(self, parameters: Any, settings: Any) -> tuple[Indicator, ...]:
        """What the mounting of the redundant IMU is good for; gyros and accelerometers are mounted alike."""
        from ftcore.systems.mounting import mounting_indicators
        from ftcore.systems.sins_gps_doppler.navigator import Navigator

        return mounting_indicators(Navigator.geometry(parameters), "inertial.mounting")

    def assemble(self, parameters: Any, duration: float, runs: range, noise: NoiseSource) -> Assembly:
        """Put the system together for ``duration`` seconds."""
        from ftcore.parts import navigation
        from ftcore.systems.reporting import Reporter
        from ftcore.systems.sins_gps_doppler.navigator import Navigator
        from ftcore.systems.sins_gps_doppler.plant import Plant

        cluster = Navigator.geometry(parameters)
        plant = Plant(parameters, cluster.H, duration, noise)
        navigator = Navigator(parameters, cluster, len(runs), plant.alignment(), plant.calibration(), LAYOUT)
        reporter = Reporter(
            self.description,
            LAYOUT,
            navigation.errors,
            (diagram.blocks,),
            (inertial.items, satellites.items),
            inertial.vectors(cluster),
        )
        return Assembly(plant, navigator, reporter, LAYOUT.tests, LAYOUT.subjects, visible=plant.visible)
