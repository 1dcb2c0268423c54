"""How a person calls a subject."""

from __future__ import annotations

from ftcore.description import SystemDescription


def called(description: SystemDescription, subject: str) -> str:
    """As the subsystem, the one thing in the scene it is, or what its channels share; its own name at worst."""
    for subsystem in description.subsystems:
        if subsystem.name == subject:
            return subsystem.label
    own = [channel.name for channel in description.channels if channel.sensor == subject]
    items = [item.label for item in description.scene if len(own) == 1 and item.channel == own[0]]
    if items:
        return items[0]
    labels = [channel.label for channel in description.channels if channel.sensor == subject]
    first, last = min(labels, default=""), max(labels, default="")
    shared = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[:shared].rstrip(" ,:") or subject
