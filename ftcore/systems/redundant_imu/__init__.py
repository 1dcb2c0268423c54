"""System D: redundant IMU on a manoeuvring F-16, parity space with a UKF behind it (Kim et al., 2005)."""

from __future__ import annotations

from typing import Any

from ftcore.description import Indicator
from ftcore.noise import NoiseSource
from ftcore.systems.base import Assembly
from ftcore.systems.redundant_imu.description import description
from ftcore.systems.redundant_imu.forms import Parameters, Settings
from ftcore.systems.redundant_imu.names import SUBJECTS, TESTS


class RedundantImu:
    """See :class:`ftcore.systems.base.System`."""

    description = description()
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

        from ftcore.detection.geometry import three_two_dof
        from ftcore.systems.redundant_imu.flight import Augmentation, augmentation, mission
        from ftcore.systems.redundant_imu.jsbsim_plant import JsbsimPlant, StickLaw
        from ftcore.systems.redundant_imu.model import flight_model
        from ftcore.systems.redundant_imu.navigator import Navigator
        from ftcore.systems.redundant_imu.plant import Plant
        from ftcore.systems.redundant_imu.reporter import Reporter
        from ftcore.world.aircraft import f16

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
        navigator = Navigator(p, cluster, flight_model(believed), law, alignment)
        reporter = Reporter(cluster, p.gyros.noise, alignment[0])
        return Assembly(plant, navigator, reporter, TESTS, SUBJECTS, foresees=p.plant != "jsbsim")
