"""System C: SINS/GPS/BD2/CNS with IMM, two state propagators and tolerant fusion (Yang et al., Sensors 2016)."""

from __future__ import annotations

from typing import Any

from ftcore.noise import NoiseSource
from ftcore.parts.declared import Declared, describe
from ftcore.parts.instruments import AXES as PAIRS
from ftcore.parts.instruments import CLUSTERS
from ftcore.parts.ledger import Layout
from ftcore.systems.base import Assembly
from ftcore.systems.sins_gps_bd2_cns import aid_tests, aids, diagram, estimators, inertial, sky, weights
from ftcore.systems.sins_gps_bd2_cns.forms import EPOCH, Parameters, Settings
from ftcore.systems.sins_gps_bd2_cns.inertial import BODY

PARTS = (weights, aid_tests, aids, estimators, inertial, sky, diagram)
DECLARED = sum((part.DECLARED for part in PARTS), Declared())
LAYOUT = Layout(DECLARED)


class SinsGpsBd2Cns:
    """See :class:`ftcore.systems.base.System`."""

    description = describe(
        DECLARED,
        id="sins-gps-bd2-cns",
        title="SINS/GPS/BD2/CNS with IMM and tolerant fusion",
        summary=(
            "A strapdown inertial system aided by two satellite systems and a star tracker, over an hour of high and "
            "low manoeuvre. Two alternating propagators test every aid, an interacting multiple model adapts to the "
            "manoeuvre, and eight subsets of aids are fused by how much each aid may be believed."
        ),
        source=(
            "C. Yang, A. Mohammadi and Q.-W. Chen, Multi-sensor fusion with interaction multiple model and chi-square "
            "test tolerant filter, Sensors 16 (2016) 1835"
        ),
        epoch=EPOCH,
        estimators=estimators.ESTIMATORS,
        shown=("weights", "two-propagator-gps", "imm-gps", "models", "position-east", "attitude-up"),
        settings_schema=Settings.model_json_schema(),
        parameters_schema=Parameters.model_json_schema(),
        score_headline=("fused.error.position.horizontal", "unprotected.error.position.horizontal"),
        score_label="Worst horizontal error",
    )
    Parameters = Parameters
    Settings = Settings

    def assemble(self, parameters: Any, duration: float, runs: range, noise: NoiseSource) -> Assembly:
        """Put the system together for ``duration`` seconds. Raises ValueError for a path that cannot be flown."""
        from functools import partial

        from ftcore.parts import navigation
        from ftcore.systems.reporting import Reporter
        from ftcore.systems.sins_gps_bd2_cns.imu import input_axes
        from ftcore.systems.sins_gps_bd2_cns.navigator import Navigator
        from ftcore.systems.sins_gps_bd2_cns.plant import Plant

        p: Parameters = parameters
        axes = input_axes(p)
        plant = Plant(p, axes, duration, noise)
        navigator = Navigator(p, plant.chart, len(runs), plant.alignment(), plant.calibration(), LAYOUT)
        reporter = Reporter(
            self.description,
            LAYOUT,
            navigation.errors,
            (partial(diagram.blocks, redundant=p.inertial.configuration == "redundant"),),
            (sky.items,),
            inertial.vectors(axes) | sky.VECTORS,
            sky.Sky(p.aiding).draw,
        )
        return Assembly(
            plant,
            navigator,
            reporter,
            LAYOUT.tests,
            LAYOUT.subjects,
            absent=_absent(p),
        )


def _absent(p: Parameters) -> dict[str, str]:
    """Channels of the IMU that is not fitted."""
    fitted = p.inertial.configuration
    other, axes = {"three-axis": ("redundant", PAIRS), "redundant": ("three-axis", BODY)}[fitted]
    reason = f"the {fitted} IMU is fitted; parameter inertial.configuration = {other!r} brings this channel"
    return {f"imu.{cluster}.{axis}": reason for cluster in CLUSTERS for axis in axes}
