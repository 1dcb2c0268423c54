"""What the navigator announces of an epoch besides alarms and health, with the numbers behind it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ftcore.detection import supervisor
from ftcore.parts.instruments import CLUSTERS
from ftcore.systems.base import Notice
from ftcore.systems.sins_gps_doppler import overruled
from ftcore.systems.sins_gps_doppler.aid_tests import AidTestResult
from ftcore.systems.sins_gps_doppler.aids import AIDS, SLOTS
from ftcore.systems.sins_gps_doppler.altimeter import AltimeterEpoch
from ftcore.systems.sins_gps_doppler.forms import EPOCH
from ftcore.systems.sins_gps_doppler.history import Culprits, History
from ftcore.systems.sins_gps_doppler.imu import ImuEpoch

Array = NDArray[np.float64]


def of_aids(decision: supervisor.Decision, tests: AidTestResult) -> list[Notice]:
    """Which channel of GPS or Doppler the likelihood ratio names, and whose filter starts anew."""
    notices = []
    for j, subject in enumerate(AIDS):
        back, out = decision.just_readmitted[:, j], decision.just_isolated[:, j]
        if back.any():
            notices.append(Notice("filter.reset", subject, back, {}))
        if out.any():
            for column in np.unique(tests.culprit[out, j]):
                if column >= 0:
                    where = out & (tests.culprit[:, j] == column)
                    part, unit = _channel(subject, int(column))
                    numbers = {f"estimated_fault [{unit}]": tests.size[:, j]}
                    notices.append(Notice("channel.named", f"{subject}.{part}", where, numbers))
    return notices


def of_imu(imu: ImuEpoch) -> list[Notice]:
    """What became of the redundant IMU."""
    notices = []
    names = tuple(CLUSTERS)
    for c, cluster in enumerate(names):
        for kind, where in (
            ("integrity.cannot-isolate", imu.undecided.just_isolated[:, c]),
            ("integrity.restored", imu.undecided.just_readmitted[:, c]),
        ):
            if where.any():
                # While all are in use there is no rest: it is the parity of all that contradicts.
                few = imu.rest.dof[:, c] > 0
                numbers = {
                    name: np.where(few, rest[:, c], whole.reshape(len(few), -1)[:, c])
                    for name, rest, whole in (
                        ("statistic", imu.rest.statistic, imu.sight.FD),
                        ("threshold", imu.rest.threshold, imu.sight.threshold),
                    )
                }
                notices.append(Notice(kind, f"imu.{cluster}", where, numbers))
    if imu.changed.any():
        numbers = {f"{name}s_used": imu.used[:, c].sum(axis=-1).astype(float) for c, name in enumerate(names)}
        notices.append(Notice("imu.reconfigured", "imu", imu.changed, numbers))
    return notices


def of_altimeter(judged: AltimeterEpoch) -> list[Notice]:
    """How far the altimeter is off when it is put out, and what its bias is known to when it comes back."""
    notices = []
    out, back = judged.decision.just_isolated[:, 0], judged.decision.just_readmitted[:, 0]
    if out.any():
        notices.append(
            Notice("channel.named", "altimeter.height", out, {"estimated_fault [m]": -np.nan_to_num(judged.innovation)})
        )
    if back.any():
        numbers = {"bias_changed [m]": judged.shift, "bias_opened [m]": np.sqrt(judged.opened)}
        notices.append(Notice("filter.reset", "altimeter", back, numbers))
    return notices


def reopened(opening: Array) -> list[Notice]:
    """How far the filters were opened because GPS and Doppler overrule the inertial solution; ``opening (runs,)``."""
    if not opening.any():
        return []
    numbers = {
        "position [m]": opening * overruled.POSITION,
        "velocity [m/s]": opening * overruled.VELOCITY,
        "attitude [rad]": opening * overruled.ATTITUDE,
    }
    return [Notice("filter.reopened", "imu", opening > 0.0, numbers)]


def flown_again(history: History, culprits: Culprits | None) -> list[Notice]:
    """Whose measurements were taken out of the past, and since when."""
    if culprits is None:
        return []
    first = culprits.since.astype(np.float64)
    numbers = {"since [s]": first * EPOCH, "epochs": history.now + 1.0 - first}
    who = {
        **{name: culprits.aids[:, j] for j, name in enumerate(AIDS)},
        "altimeter": culprits.altimeter,
        **{f"gps.{slot}": culprits.satellites[:, i] for i, slot in enumerate(SLOTS)},
    }
    return [Notice("filter.reflown", name, where, numbers) for name, where in who.items() if where.any()]


def _channel(subject: str, column: int) -> tuple[str, str]:
    """Part and unit behind a measurement column."""
    if subject == "gps":
        return SLOTS[column % len(SLOTS)], "m" if column < len(SLOTS) else "m/s"
    return "xyz"[column], "m/s"
