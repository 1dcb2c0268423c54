"""Faults that can never act: refused when they are laid, with what would be right.

What may act later is taken. Silent for now, it says why; see :mod:`ftcore.acting`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ftcore import units
from ftcore.commands import CommandError
from ftcore.faults import ChannelAddress, Fault, si_magnitude
from ftcore.injection import addition, live_at
from ftcore.readings import Readings
from ftcore.systems.base import Visible

Array = NDArray[np.float64]

NOTHING = 1e-6
"""A sine that never exceeds this share of its magnitude at any reading counts as sampled at its zeros."""
SPREAD = 8.0
"""Standard deviations that random faults do not exceed, in fewer than 1e-15 of all readings."""
LAST_BIT = 2.0**-54
"""An addition smaller than this share of a number is lost in rounding, whatever the number."""
MARGIN = 2.0**-7
"""By how much smaller than now a reading may become, before an addition that is lost now would show."""


@dataclass(frozen=True)
class Outlook:
    """What is known of the rest of a flight.

    Attributes:
        seen: clean readings of the last epoch, of the first one before it is flown; None where they are not known.
        epoch, last_epoch: epochs flown, and how many there will be.
        period: seconds between epochs.
        visible: see :attr:`ftcore.systems.base.Assembly.visible`.
    """

    seen: Readings | None
    epoch: int
    last_epoch: int
    period: float
    visible: Visible | None


def refuse_idle(fault: Fault, address: ChannelAddress, outlook: Outlook, has_acted: bool = False) -> None:
    """Refuse a fault that can never act on what is left of the flight.

    Args:
        fault: with its start.
        address: of its channel.
        outlook: what is left.
        has_acted: one that has acted before may come to an end between two readings.

    Raises:
        CommandError: it can never act; the field says what stands in the way.
    """
    assert fault.start is not None
    if outlook.epoch >= outlook.last_epoch:
        over = outlook.last_epoch * outlook.period
        raise CommandError("start", f"the flight is over at {over:g} s; rewind it, or fork from before")
    if not has_acted:
        first = _first_reading(fault, address, outlook)
        _refuse_zeros(fault, address, outlook)
        last = outlook.last_epoch * outlook.period
        until = last if fault.end is None else min(fault.end, last)
        if outlook.visible is not None and not outlook.visible(fault.channel, first, until):
            raise CommandError("channel", f"{fault.channel} is at no time in view from {first:g} to {until:g} s")
    _refuse_rounding(fault, address, outlook)


def _times(fault: Fault, address: ChannelAddress, outlook: Outlook) -> Iterator[Array]:
    """Times of the readings to come at which the fault is live, a few first, then in large pieces."""
    assert fault.start is not None
    offsets = _offsets(address, outlook)
    k = max(outlook.epoch + 1, int((fault.start - offsets.max()) / outlook.period) - 1)
    last = outlook.last_epoch
    if fault.end is not None:
        last = min(last, int((fault.end - offsets.min()) / outlook.period) + 1)
    size = 16
    while k <= last:
        epochs = np.arange(k, min(k + size, last + 1), dtype=np.float64)
        times = (epochs[:, None] * outlook.period + offsets).ravel()
        yield times[live_at(fault, times)]
        k, size = k + size, 4096


def _offsets(address: ChannelAddress, outlook: Outlook) -> Array:
    """When the channel is read, against the end of the epoch [s]."""
    if outlook.seen is None:
        return np.zeros(1)
    offsets: Array = np.atleast_1d(outlook.seen[address.group].times) - outlook.seen.time
    return offsets


def _interval(address: ChannelAddress, outlook: Outlook) -> float:
    offsets = _offsets(address, outlook)
    return float(offsets[1] - offsets[0]) if len(offsets) > 1 else outlook.period


def _first_reading(fault: Fault, address: ChannelAddress, outlook: Outlook) -> float:
    """Time of the first reading at which the fault is live. Raises CommandError where there is none."""
    assert fault.start is not None
    for times in _times(fault, address, outlook):
        if len(times):
            return float(times[0])
    offsets = _offsets(address, outlook)
    last = outlook.last_epoch * outlook.period + offsets[-1]
    if fault.start > last:
        raise CommandError(
            "start", f"start is {fault.start:g} s, but the last reading of this flight is at {last:g} s; start earlier"
        )
    every = _interval(address, outlook)
    now = outlook.epoch * outlook.period
    raise CommandError(
        "end",
        f"no reading of {fault.channel} is left between {max(now, fault.start):g} s and the end at {fault.end:g} s; "
        f"there is one every {every:g} s: end it later",
    )


def _refuse_zeros(fault: Fault, address: ChannelAddress, outlook: Outlook) -> None:
    """A ramp or sine that is zero whenever it is read."""
    if fault.kind not in ("ramp", "sine"):
        return
    assert fault.start is not None
    readings = 0
    for times in _times(fault, address, outlook):
        readings += len(times)
        if np.any(np.abs(addition(fault, 1.0, times - fault.start)) > NOTHING):
            return
    every = _interval(address, outlook)
    if fault.kind == "sine" and readings > 1:
        raise CommandError(
            "angular_frequency",
            f"a sine of {fault.angular_frequency:g} rad/s is zero at every reading, one every {every:g} s; another "
            "angular frequency acts",
        )
    raise CommandError("end", f"the {fault.kind} is zero at the only reading that it lasts for; let it last longer")


def _refuse_rounding(fault: Fault, address: ChannelAddress, outlook: Outlook) -> None:
    """A magnitude so small that the reading stays the same to its last bit."""
    assert fault.start is not None
    size = abs(si_magnitude(fault, address.unit))
    if fault.kind == "scale-factor" and 1.0 + si_magnitude(fault, address.unit) == 1.0:
        raise CommandError("magnitude", "1 + magnitude is 1 to the last bit; at least 2.3e-16 changes a reading")
    if outlook.seen is None:
        return
    group = outlook.seen[address.group]
    if fault.kind == "delay" and np.array_equal(np.subtract(group.times, size), group.times):
        raise CommandError("magnitude", f"a delay of {size:g} s is lost in the time's last bit; give a longer one")
    last = outlook.last_epoch * outlook.period
    seconds = (last if fault.end is None else min(fault.end, last)) - fault.start
    reach = {
        "bias": size,
        "sine": size,
        "outliers": size,
        "ramp": size * seconds,
        "noise": SPREAD * size,
        "random-walk": SPREAD * size * float(np.sqrt(max(0.0, seconds))),
    }.get(fault.kind)
    columns = list(address.parts)
    valid = np.broadcast_to(group.valid, group.values.shape[:2])[:, columns]
    if reach is None or not valid.all():
        return
    least = float(np.abs(group.values[:, columns]).min())
    if reach < least * LAST_BIT * MARGIN:
        shown = units.from_si(least, address.unit)
        raise CommandError(
            "magnitude",
            f"{fault.magnitude:g} is below the last bit of {fault.channel}, which reads {shown:.4g} {address.unit}; "
            "give a larger one",
        )
