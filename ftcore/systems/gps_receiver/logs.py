"""A receiver's log as a scenario: what `ftlab run` and an upload make of a pair of RINEX files."""

from __future__ import annotations

from typing import Any

from ftcore.sensors import rinex
from ftcore.sensors.rinex_text import OBSERVATION, refusal
from ftcore.systems.base import NOISE_FLOOR
from ftcore.systems.gps_receiver.forms import Log


def log_scenario(
    observation: str,
    navigation: str,
    antenna: tuple[float, float, float] | None = None,
    max_epochs: int = rinex.MAX_EPOCHS,
    noise_floor: float | None = None,
) -> dict[str, Any]:
    """Scenario document that plays a log from its first epoch to its last.

    Args:
        observation, navigation: the files, as the scenario will name them.
        antenna: true position, Earth-fixed [m]; the file's approximate position if absent.
        max_epochs: of the longest log that is taken.
        noise_floor: pseudorange 1-sigma that is assumed at every elevation [m]; the form's if absent.

    Raises:
        LogError: one sentence about the file that cannot be used.
    """
    from ftcore.systems.gps_receiver.plant import reference

    least, usual, most = NOISE_FLOOR
    floor = usual if noise_floor is None else noise_floor
    if not least <= floor <= most:
        raise rinex.LogError(f"a noise floor of {floor:g} m is not taken; {least:g} to {most:g} m are", "floor")
    log = rinex.read(observation, navigation)
    if len(log) > max_epochs:
        raise refusal(OBSERVATION, f"has {len(log)} epochs; at most {max_epochs} are taken")
    form = Log(observation=observation, navigation=navigation, antenna=antenna, floor=floor)
    reference(log, form)
    return {
        "id": "receiver-log",
        "title": f"Receiver log of {log.start}",
        "summary": (
            f"{len(log)} epochs of {log.interval:g} s from {log.start}. The pseudoranges are the receiver's own; "
            "faults lie over them. Errors are against the position of the antenna"
            + (", as the observation file's header has it, which may be metres off." if antenna is None else ".")
        ),
        "hint": "Press Run, then break a satellite that is in view: it must turn grey, and the error must not move.",
        "source": "a receiver's log",
        "system": "gps-receiver",
        "duration": len(log) * log.interval,
        "parameters": {"log": form.model_dump(mode="json", exclude_defaults=True)},
    }
