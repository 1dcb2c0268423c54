"""System D: redundant IMU on a manoeuvring F-16, parity space with a UKF behind it (Kim et al., 2005)."""

from __future__ import annotations

from typing import Any

from ftcore.description import Indicator
from ftcore.noise import NoiseSource
from ftcore.parts.declared import describe
from ftcore.parts.ledger import Layout, Ledger
from ftcore.systems.base import Assembly
from ftcore.systems.redundant_imu import aircraft, analytic, decision, fdi, gyros
from ftcore.systems.redundant_imu.forms import Parameters, Settings

DECLARED = gyros.DECLARED + fdi.DECLARED + analytic.DECLARED + decision.DECLARED + aircraft.DECLARED
LAYOUT = Layout(DECLARED)


class RedundantImu:
    """See :class:`ftcore.systems.base.System`."""

    description = describe(
        DECLARED,
        id="redundant-imu",
        title="Redundant IMU on an F-16",
        summary=(
            "Three two-axis gyros fly an F-16 through a climb and a bank turn. Parity space detects a fault; where two "
            "gyros look guilty an unscented Kalman filter on the aircraft's own dynamics decides."
        ),
        source=(
            "H.S. Kim, S.K. Park, Y. Kim and C.G. Park, Hybrid fault detection and isolation method for UAV inertial "
            "sensor redundancy management system, IFAC 2005"
        ),
        epoch=aircraft.EPOCH,
        estimators=aircraft.ESTIMATORS,
        shown=("detection", "isolation-angle", "ukf", "distance", "height"),
        settings_schema=Settings.model_json_schema(),
        parameters_schema=Parameters.model_json_schema(),
        score_headline=("protected.distance", "unprotected.distance"),
        # Seconds for which a fault may still show after its end: a gyro is back after half a second of agreement.
        recovery=2.0,
        score_label="Furthest off the healthy path",
    )
    Parameters = Parameters
    Settings = Settings

    def indicators(self, parameters: Any, settings: Any) -> tuple[Indicator, ...]:
        """What the mounting is good for: indices, fault planes, least fault seen, faults that cannot be placed."""
        import math

        from ftcore.detection.geometry import three_two_dof
        from ftcore.systems.mounting import ambiguity_indicators, detection_indicator, mounting_indicators
        from ftcore.systems.redundant_imu import fdi

        p: Parameters = parameters
        s: Settings = settings
        cluster = three_two_dof(*(math.radians(angle) for angle in p.gyros.mounting))
        expected = fdi.reference(cluster, p.gyros.noise)
        field = "gyros.mounting"
        return (
            *mounting_indicators(cluster, field),
            detection_indicator(expected, s.false_alarm_probability, "rad/s", "gyros.noise"),
            *ambiguity_indicators(expected, math.radians(s.angle_threshold), field, "gyro"),
        )

    def assemble(self, parameters: Any, duration: float, runs: range, noise: NoiseSource) -> Assembly:
        """Put the system together for ``duration`` seconds. Raises JsbsimError where JSBSim is asked for and cannot."""
        import math
        from functools import partial

        from ftcore.detection.geometry import three_two_dof
        from ftcore.systems.redundant_imu.flight import Augmentation, augmentation, mission
        from ftcore.systems.redundant_imu.jsbsim_plant import JsbsimPlant, StickLaw
        from ftcore.systems.redundant_imu.model import flight_model
        from ftcore.systems.redundant_imu.navigator import Navigator
        from ftcore.systems.redundant_imu.plant import Plant
        from ftcore.systems.reporting import Reporter
        from ftcore.world.aircraft import S, f16

        p: Parameters = parameters
        cluster = three_two_dof(*(math.radians(angle) for angle in p.gyros.mounting))
        believed = f16()
        wanted = mission(believed, p.flight)
        plant: Plant | JsbsimPlant
        law: Augmentation | StickLaw
        if p.plant == "jsbsim":
            plant, law = JsbsimPlant(p, cluster.H, noise, duration), StickLaw(wanted)
        else:
            plant, law = Plant(p, cluster.H, noise), augmentation(believed, p.flight, wanted)
        alignment = plant.alignment()
        navigator = Navigator(p, cluster, flight_model(believed), law, alignment, LAYOUT)
        geometry = gyros.Geometry(cluster, p.gyros.noise)
        start = alignment[0][0, aircraft.HEALTHY, S.EAST : S.UP + 1]

        def outside(truth: aircraft.Truth, say: Ledger) -> None:
            geometry.report(say)
            aircraft.errors(truth, say, start)

        blocks = (geometry.blocks, partial(fdi.blocks, geometry=geometry), analytic.blocks, decision.blocks)
        reporter = Reporter(
            self.description, LAYOUT, outside, (*blocks, aircraft.blocks), (fdi.items,), geometry.vectors
        )
        return Assembly(plant, navigator, reporter, LAYOUT.tests, LAYOUT.subjects, foresees=p.plant != "jsbsim")
