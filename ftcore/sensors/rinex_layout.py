"""How a GPS record of a RINEX observation file is laid out: its observables in order, and the scale of its numbers.

Source: RINEX 2.11, table A1; RINEX 3.05, table A2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ftcore.sensors import rinex_text
from ftcore.sensors.rinex_text import Record, Text


@dataclass(frozen=True)
class Layout:
    """How a GPS record is laid out: its observables in order, and what stored values are multiplied by."""

    codes: tuple[str, ...] = ()
    factors: Mapping[str, float] = field(default_factory=dict)

    def factor(self, code: str) -> float:
        """What a stored value of this observable is multiplied by."""
        return self.factors.get(code, self.factors.get("", 1.0))


def observables(text: Text, version: int, records: list[Record]) -> tuple[str, ...] | None:
    """The observables of a GPS record in order, None if the records do not list them.

    Raises:
        LogError: the list is not whole, by its line.
    """
    label, head = ("# / TYPES OF OBSERV", 6) if version == 2 else ("SYS / # / OBS TYPES", 7)
    codes: list[str] | None = None
    count, line, system = 0, 0, ""
    for record in records:
        if record.label != label:
            continue
        number = rinex_text.whole(record.content[head - 6 if version == 2 else 3 : 6])
        if version == 3 and record.content[0].strip():
            system = record.content[0].upper()
        if version == 3 and system != "G":
            continue
        if number is not None:
            codes, count, line = [], number, record.line
        if codes is None:
            raise text.corrupt(record.line, "a list of observables begins without their number")
        codes += record.content[head:].upper().split()
    if codes is None:
        return None
    if len(codes) != count or not count or any(len(code) != version for code in codes):
        raise text.corrupt(line, f"it announces {count} observables, and {len(codes)} are listed")
    return tuple(codes)


def scale_factors(text: Text, version: int, records: list[Record]) -> dict[str, float] | None:
    """Factor by code, "" for all, of SYS / SCALE FACTOR or RINEX 2's OBS SCALE FACTOR; None if there is none.

    Raises:
        LogError: a factor that the format does not know, by its line.
    """
    factors: dict[str, float] | None = None
    system, size, left = "", 1.0, 0
    for record in records:
        words = record.content
        if record.label == "SYS / SCALE FACTOR" and version == 3:
            if words[0].strip():
                system, value, number = words[0].upper(), words[2:6], words[8:10]
            else:
                value, number = "", ""
            codes = words[10:].upper().split()
        elif record.label == "OBS SCALE FACTOR" and version == 2:
            system, value, number, codes = "G", words[:6], words[6:12], words[12:].upper().split()
        else:
            continue
        if system != "G":
            continue
        if value.strip():
            given = rinex_text.whole(value)
            if given not in (1, 10, 100, 1000):
                raise text.corrupt(record.line, "a scale factor is 1, 10, 100 or 1000")
            size, left = 1.0 / given, rinex_text.whole(number) or 0
            factors = {} if factors is None else factors
            if left == 0:
                factors[""] = size
        if factors is None or (left and not codes):
            raise text.corrupt(record.line, "a scale factor does not say of which observables")
        factors |= dict.fromkeys(codes, size)
    return factors
