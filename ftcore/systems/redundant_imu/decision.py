"""Who is in doubt, who is out, and what control flies on."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.description import Block, BlockView, Chart, Trace, Wire
from ftcore.parts.declared import Declared, Signals
from ftcore.parts.ledger import Ledger
from ftcore.systems.base import Flags
from ftcore.systems.redundant_imu.gyros import GYRO, SUBJECTS
from ftcore.systems.reporting import Now

DECLARED: Final = Declared(
    signals=(
        Signals("isolation.ambiguous", "ambiguous: the UKF cannot tell either", "1", "decision"),
        Signals("control.by-ukf", "control flies on the rates of the UKF", "1", "decision"),
    ),
    charts=(
        Chart(
            id="used",
            title="Gyros in use, UKF, ambiguity",
            unit="1",
            group="decisions",
            traces=(
                Trace(signal="used.imu.gyro.{gyro}", label="{gyro} used", role="weight"),
                Trace(signal="ukf.active", label="UKF runs"),
                Trace(signal="isolation.ambiguous", label="ambiguous"),
            ),
        ),
    ),
    blocks=(
        Block(
            id="supervisor", label="Supervisor", kind="supervisor", x=52, y=19, width=23, height=14,
            settings=("confirm", "within", "hold_off"),
        ),
        Block(id="control", label="LQR control", kind="master", x=78, y=19, width=21, height=14),
    ),
    # The aircraft's motion closes the loop through the sensors.
    wires=(
        *(Wire(source=f"gyro-{k}", target="control", carries=f"{GYRO}.{k}") for k in (1, 2, 3)),
        Wire(source="supervisor", target="control"),
        Wire(source="control", target="mission"),
    ),
)  # fmt: skip


def report(say: Ledger, health: NDArray[np.int64], used: Flags, doubted: Flags, told: Flags, from_model: Flags) -> None:
    """The decision of an epoch.

    Args:
        health, used, doubted: ``(runs, 3)`` of each gyro; doubted: it is not known whether it is at fault.
        told: ``(runs,)`` nobody can tell who is at fault.
        from_model: ``(runs,)`` the rates are the UKF's.
    """
    say.judge("imu.gyro.{gyro}", health, used)
    say["used.imu.gyro.{gyro}"] = used
    say["isolation.ambiguous"], say["control.by-ukf"] = told, from_model
    say.values["doubted"] = doubted


def blocks(now: Now) -> dict[str, BlockView]:
    """The diagram's blocks of supervisor and control."""
    trusted = {
        "supervisor": BlockView(health="ok", text="all trusted"),
        "control": BlockView(health="ok", text="rates of 3 gyros"),
    }
    if now.said is None:
        return trusted
    isolated = [s[-1] for s in SUBJECTS if now.health[s] == "isolated"]
    suspects = [s[-1] for s in SUBJECTS if now.health[s] == "suspect"]
    if isolated or suspects:
        tied = now.said["isolation.ambiguous"][0] > 0.0
        out = f"gyro {', '.join(isolated)} out" if isolated else ""
        doubts = f"{'cannot tell: ' if tied else 'doubts '}{', '.join(suspects)}" if suspects else ""
        both = "; ".join(text for text in (out, doubts) if text)
        trusted["supervisor"] = BlockView(health="isolated" if isolated else "suspect", text=both)
    used, from_model = now.said["used.imu.gyro.{gyro}"][0] > 0.0, now.said["control.by-ukf"][0] > 0.0
    number = int(used.sum())
    text = f"rates of {number} gyros" if number > 1 else ("gyro rates held", "1 gyro, third rate held")[number]
    in_doubt = from_model or number < 2 or (used & now.said.values["doubted"][0]).any()
    trusted["control"] = BlockView(
        health="suspect" if in_doubt else "ok", text="rates of the UKF" if from_model else text
    )
    return trusted
