"""The systems there are. A fifth one is added here and nowhere else."""

from __future__ import annotations

from ftcore.systems.base import System
from ftcore.systems.gps_receiver import GpsReceiver
from ftcore.systems.redundant_imu import RedundantImu
from ftcore.systems.sins_gps_bd2_cns import SinsGpsBd2Cns
from ftcore.systems.sins_gps_doppler import SinsGpsDoppler


def all_systems() -> dict[str, System]:
    """System id -> system, in the order a person is shown them."""
    systems: list[System] = [SinsGpsDoppler(), GpsReceiver(), RedundantImu(), SinsGpsBd2Cns()]
    return {system.description.id: system for system in systems}


SYSTEMS = all_systems()
