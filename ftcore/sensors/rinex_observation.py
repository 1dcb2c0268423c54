"""RINEX 2 and 3 observation files: the GPS code pseudoranges on L1 out of everything that a receiver logs.

The file is walked epoch by epoch, which is cheap: only epoch lines and events are looked at. The pseudoranges of all
epochs are then cut out of their lines at once. What is read follows what stands in the file from there on: a new list
of observables, a new scale, a second header. What cannot be followed, a site that changes above all, is refused.
Source: RINEX 2.11, tables A1 and A2; RINEX 3.05, tables A2 and A3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ftcore.sensors import rinex_text
from ftcore.sensors.rinex_text import FIRST, OBSERVATION, Array, LogError, Record, Text, date, refusal

PRNS: Final = 32
CODES: Final = {2: ("C1", "P1"), 3: ("C1C", "C1W", "C1P", "C1X", "C1S", "C1L", "C1Y")}
"""Code on L1, the civil one first: the first of them that has a value is read, satellite by satellite."""
_SYSTEMS: Final = b"GRSECJIX"
_TIMES: Final = ("", "GPS", "GAL", "QZS", "IRN")
"""Time systems that keep GPS time to nanoseconds."""
_SAME_SITE, _NEAR_SITE = 1.0, 100.0
"""Approximate positions this close [m] are the same, and of the same site."""


@dataclass(frozen=True)
class Observations:
    """What is read of an observation file, in the order of the file.

    Attributes:
        stamps: (epochs,) time tags, seconds of the continuous GPS time scale; an epoch may be there twice.
        lines: (epochs,) line of each epoch, from 1 on.
        pseudorange: (epochs, 32) by satellite number from 1 on [m], NaN where there is none.
        interval: of the header [s], or None.
        position: approximate, Earth-fixed (3,) [m], or None.
        notes: what a person has to know of the reading.
    """

    stamps: Array
    lines: NDArray[np.int64]
    pseudorange: Array
    interval: float | None
    position: Array | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Layout:
    """How a GPS record is laid out: its observables in order, and what stored values are multiplied by."""

    codes: tuple[str, ...] = ()
    factors: Mapping[str, float] = field(default_factory=dict)

    def factor(self, code: str) -> float:
        return self.factors.get(code, self.factors.get("", 1.0))


@dataclass
class _Walk:
    """A file that is being walked: where it stands, and what has been found."""

    text: Text
    version: int
    at: int
    layout: _Layout = field(default_factory=_Layout)
    blank: str = "G"
    position: Array | None = None
    interval: float | None = None
    elsewhere: LogError | None = None
    """What is wrong if another epoch comes: the receiver is no longer where it was."""
    stamps: list[float] = field(default_factory=list)
    heads: list[int] = field(default_factory=list)
    layouts: list[_Layout] = field(default_factory=list)
    of: list[int] = field(default_factory=list)
    """Layout of each epoch."""
    rows: list[tuple[NDArray[np.int64], list[int]]] = field(default_factory=list)
    """First line of each GPS record of each epoch, and its satellite."""
    notes: list[str] = field(default_factory=list)


def read(content: bytes, max_epochs: int) -> Observations:
    """Read an observation file, plain text.

    Raises:
        LogError: it cannot be read, or not without guessing.
    """
    text = Text(content, OBSERVATION)
    first = text.skip_blank(0)
    records, at = text.header(first)
    version = int(rinex_text.version_of(records[0], OBSERVATION, "O"))
    walk = _Walk(text, version, at)
    _apply(walk, records, first)
    step = _epoch2 if version == 2 else _epoch3
    while (here := text.skip_blank(walk.at)) < len(text):
        walk.at = here
        if _second_header(walk):
            continue
        step(walk)
        if len(walk.stamps) > max_epochs:
            raise refusal(OBSERVATION, f"has more than {max_epochs} epochs, which is the most that is read")
    stamps, heads, pseudorange = _values(walk)
    return Observations(stamps, heads, pseudorange, walk.interval, walk.position, tuple(walk.notes))


# ---- headers, at the start and further on


def _apply(walk: _Walk, records: list[Record], line: int, new_site: bool = False) -> None:
    """Take over what header records at ``line`` say; ``new_site``: they come with event flag 3."""
    before = walk.layout
    codes, factors = _types(walk, records), _scales(walk, records)
    walk.layout = replace(
        before, codes=before.codes if codes is None else codes, factors=before.factors if factors is None else factors
    )
    if walk.stamps and walk.layout.codes != before.codes:
        walk.notes.append(f"the list of observables changes at line {line + 1}; the new one is used from there on")
    place: Array | None = None
    for record in records:
        if record.label == FIRST:
            system = record.content[40:41].upper()
            walk.blank = system if system.strip() and system != "M" else "G"
        elif record.label == "INTERVAL":
            walk.interval = rinex_text.number(record.content[:10])
        elif record.label == "TIME OF FIRST OBS":
            system = record.content[48:51].strip().upper()
            if system not in _TIMES:
                shown = system if system.isalnum() else "another"
                raise refusal(OBSERVATION, f"keeps {shown} time, says line {record.line + 1}; only GPS time is read")
        elif record.label == "APPROX POSITION XYZ":
            place, line = rinex_text.place(record.content), record.line
    _located(walk, place, line, new_site)


def _located(walk: _Walk, place: Array | None, line: int, new_site: bool) -> None:
    """An approximate position was given, or a new site was announced."""
    known = walk.position
    if not walk.stamps:
        walk.position = known if place is None else place
        if new_site:
            walk.elsewhere = None
        return
    apart = math.inf if place is None or known is None else float(np.linalg.norm(place - known))
    if apart <= _SAME_SITE:
        walk.elsewhere = None if new_site else walk.elsewhere
        return
    if new_site or (place is not None and known is not None and apart > _NEAR_SITE):
        named = "" if place is None else " at ({:.1f}, {:.1f}, {:.1f})".format(*place)
        why = "event flag 3, a new site" if new_site else "another approximate position"
        walk.elsewhere = refusal(
            OBSERVATION,
            f"is of more than one place: {why}{named} at line {line + 1}; a receiver that stands still is read, split "
            "the file there",
        )
    elif place is not None and known is not None:
        walk.notes.append(
            f"the approximate position changes by {apart:.1f} m at line {line + 1}; the first one is kept"
        )
    elif place is not None:
        walk.position = place


def _types(walk: _Walk, records: list[Record]) -> tuple[str, ...] | None:
    """The observables of a GPS record in order, None if the records do not list them."""
    label, head = ("# / TYPES OF OBSERV", 6) if walk.version == 2 else ("SYS / # / OBS TYPES", 7)
    codes: list[str] | None = None
    count, line, system = 0, 0, ""
    for record in records:
        if record.label != label:
            continue
        number = rinex_text.whole(record.content[head - 6 if walk.version == 2 else 3 : 6])
        if walk.version == 3 and record.content[0].strip():
            system = record.content[0].upper()
        if walk.version == 3 and system != "G":
            continue
        if number is not None:
            codes, count, line = [], number, record.line
        if codes is None:
            raise walk.text.corrupt(record.line, "a list of observables begins without their number")
        codes += record.content[head:].upper().split()
    if codes is None:
        return None
    if len(codes) != count or not count or any(len(code) != walk.version for code in codes):
        raise walk.text.corrupt(line, f"it announces {count} observables, and {len(codes)} are listed")
    return tuple(codes)


def _scales(walk: _Walk, records: list[Record]) -> dict[str, float] | None:
    """Factor by code, "" for all, of SYS / SCALE FACTOR or RINEX 2's OBS SCALE FACTOR; None if there is none."""
    factors: dict[str, float] | None = None
    system, size, left = "", 1.0, 0
    for record in records:
        words = record.content
        if record.label == "SYS / SCALE FACTOR" and walk.version == 3:
            if words[0].strip():
                system, value, number = words[0].upper(), words[2:6], words[8:10]
            else:
                value, number = "", ""
            codes = words[10:].upper().split()
        elif record.label == "OBS SCALE FACTOR" and walk.version == 2:
            system, value, number, codes = "G", words[:6], words[6:12], words[12:].upper().split()
        else:
            continue
        if system != "G":
            continue
        if value.strip():
            given = rinex_text.whole(value)
            if given not in (1, 10, 100, 1000):
                raise walk.text.corrupt(record.line, "a scale factor is 1, 10, 100 or 1000")
            size, left = 1.0 / given, rinex_text.whole(number) or 0
            factors = {} if factors is None else factors
            if left == 0:
                factors[""] = size
        if factors is None or (left and not codes):
            raise walk.text.corrupt(record.line, "a scale factor does not say of which observables")
        factors |= dict.fromkeys(codes, size)
    return factors


def _second_header(walk: _Walk) -> bool:
    """Take over a header, or a line of one, that stands between two epochs; False if none does."""
    label = walk.text.label(walk.at)
    if label == FIRST:
        line = walk.at
        records, after = walk.text.header(line)
        version = int(rinex_text.version_of(records[0], OBSERVATION, "O"))
        if version != walk.version:
            raise walk.text.corrupt(line, f"a header of RINEX {version} stands in a file of RINEX {walk.version}")
        walk.notes.append(f"another header stands at line {line + 1}; it is followed from there on")
        _apply(walk, records, line)
        walk.at = after
        return True
    if label in rinex_text.LABELS:
        raise walk.text.corrupt(
            walk.at, f"{label}, a line of a header, stands between the epochs with no event to announce it"
        )
    return False


# ---- epochs


def _event(walk: _Walk, flag: int, count: int) -> None:
    """Event flags 2 to 5 at the line where the walk stands, with ``count`` lines of a header."""
    line = walk.at
    if line + 1 + count > len(walk.text):
        raise walk.text.truncated()
    records = [walk.text.record(i) for i in range(line + 1, line + 1 + count)]
    walk.at = line + 1 + count
    if flag == 5:  # an external event between two epochs: no observation, nothing to follow
        return
    if flag == 2 and walk.elsewhere is None:
        walk.elsewhere = refusal(
            OBSERVATION,
            f"is of a receiver that moves: event flag 2 at line {line + 1}; one that stands still is read, split the "
            "file there",
        )
    kept = [record for record in records if record.label and record.label != rinex_text.COMMENT]
    _apply(walk, kept, line, flag == 3)


def _flag_and_count(walk: _Walk, flag: str, count: str) -> tuple[int, int]:
    """Both numbers of an epoch line; a blank one is 0, as in all of this format."""
    a, b = rinex_text.whole(flag or "0"), rinex_text.whole(count or "0")
    if flag.strip() == "":
        a = 0
    if count.strip() == "":
        b = 0
    if b == 0 and not count.strip() and a in (0, 1, 6):
        raise walk.text.corrupt(walk.at, "the number of its satellites was expected")
    if a is None or b is None or b < 0 or not 0 <= a <= 6:
        raise walk.text.corrupt(walk.at, "an epoch's flag (0 to 6) and number of records were expected")
    return a, b


def _begin(walk: _Walk, flag: int, time: float | None, rows: NDArray[np.int64], satellites: list[int]) -> None:
    """An epoch with observations."""
    if time is None:
        raise walk.text.corrupt(walk.at, "an epoch's date and time were expected")
    if walk.elsewhere is not None:
        raise walk.elsewhere
    if flag == 1:
        walk.notes.append(f"the receiver lost power before {date(time)} (line {walk.at + 1})")
    if not walk.layouts or walk.layouts[-1] is not walk.layout:
        walk.layouts.append(walk.layout)
    walk.stamps.append(time)
    walk.heads.append(walk.at + 1)
    walk.of.append(len(walk.layouts) - 1)
    walk.rows.append((rows, satellites))


def _epoch2(walk: _Walk) -> None:
    """One epoch of RINEX 2."""
    text, line = walk.text, walk.at
    head = text.line(line)
    flag, count = _flag_and_count(walk, head[28:29], head[29:32])
    if 2 <= flag <= 5:
        _event(walk, flag, count)
        return
    time = rinex_text.seconds_of([head[1:3], head[4:6], head[7:9], head[10:12], head[13:15], head[15:26]], True)
    if time is None and flag != 6:
        raise text.corrupt(line, "an epoch's date and time were expected")
    more = text.records(line + 1, max(math.ceil(count / 12) - 1, 0))
    names = "".join(part[32:68].ljust(36) for part in [head, *(text.line(int(i)) for i in more)])
    after = int(more[-1]) + 1 if len(more) else line + 1
    each = max(math.ceil(len(walk.layout.codes) / 5), 1)
    lines = text.records(after, count * each)
    if flag == 6:  # cycle slips, laid out as an epoch
        walk.at = int(lines[-1]) + 1 if len(lines) else after
        return
    found, satellites = [], []
    for i in range(count):
        letter, number = names[3 * i].upper(), names[3 * i + 1 : 3 * i + 3]
        prn = rinex_text.whole(number)
        if prn is None or (letter != " " and ord(letter) not in _SYSTEMS):
            raise text.corrupt(line, f"the name of satellite {i + 1} of {count} is none")
        if (walk.blank if letter == " " else letter) == "G" and 1 <= prn <= PRNS:
            found.append(i * each)
            satellites.append(prn - 1)
    _begin(walk, flag, time, lines.reshape(-1, each)[[k // each for k in found]], satellites)
    walk.at = int(lines[-1]) + 1 if len(lines) else after


def _epoch3(walk: _Walk) -> None:
    """One epoch of RINEX 3."""
    text, line = walk.text, walk.at
    head = text.line(line)
    if not head.startswith(">"):
        raise text.corrupt(line, "an epoch's line was expected, which begins with >")
    flag, count = _flag_and_count(walk, head[31:32], head[32:35])
    if 2 <= flag <= 5:
        _event(walk, flag, count)
        return
    lines = text.records(line + 1, count)
    after = int(lines[-1]) + 1 if count else line + 1
    if flag != 6:  # 6 is cycle slips, laid out as an epoch
        letters = text.first_bytes(lines)
        strange = ~np.isin(letters, np.frombuffer(_SYSTEMS, np.uint8))
        if strange.any():
            raise text.corrupt(int(lines[strange.argmax()]), "a satellite's record was expected")
        own = lines[letters == ord("G")]
        prns = []
        for i in own.tolist():
            prn = rinex_text.whole(text.line(i)[1:3])
            if prn is None:
                raise text.corrupt(i, "a satellite's number was expected")
            prns.append(prn - 1)
        kept = [k for k, prn in enumerate(prns) if 0 <= prn < PRNS]
        time = rinex_text.seconds_of([head[a:b] for a, b in _TIME3], False)
        _begin(walk, flag, time, own[kept][:, None], [prns[k] for k in kept])
    walk.at = after


_TIME3: Final = ((2, 6), (7, 9), (10, 12), (13, 15), (16, 18), (18, 29))


# ---- values


def _without_code(walk: _Walk) -> LogError:
    """The file offers no code on L1."""
    listed = ", ".join(code for code in walk.layout.codes if code.isalnum())[:60]
    wanted = ", ".join(CODES[walk.version][:2])
    return refusal(
        OBSERVATION,
        f"holds no code pseudorange of GPS on L1 ({wanted}); its header lists {listed or 'nothing'} for GPS",
    )


def _values(walk: _Walk) -> tuple[Array, NDArray[np.int64], Array]:
    """Time tags, lines and pseudoranges of all epochs that have any."""
    epochs = len(walk.stamps)
    result = np.full((epochs, PRNS), np.nan)
    wanted = CODES[walk.version]
    layouts = np.array(walk.of, dtype=np.int64)
    instead: dict[str, NDArray[np.int64]] = {}
    listed = {code for layout in [walk.layout, *walk.layouts] for code in layout.codes} & set(wanted)
    if not listed:
        raise _without_code(walk)
    odd: list[int] = []
    for k, layout in enumerate(walk.layouts):
        chosen = np.flatnonzero(layouts == k)
        sizes = [len(walk.rows[e][1]) for e in chosen.tolist()]
        if not sum(sizes):
            continue
        epoch = np.repeat(chosen, sizes)
        satellite = np.array([s for e in chosen.tolist() for s in walk.rows[e][1]], dtype=np.int64)
        rows = np.concatenate([walk.rows[e][0] for e in chosen.tolist() if len(walk.rows[e][1])])
        value = np.full(len(epoch), np.nan)
        codes = [code for code in wanted if code in layout.codes]
        for code in codes:
            need = np.flatnonzero(np.isnan(value))
            if not len(need):
                break
            place = layout.codes.index(code)
            line, column = (place // 5, 16 * (place % 5)) if walk.version == 2 else (0, 3 + 16 * place)
            read = walk.text.numbers(rows[need, line], column, code) * layout.factor(code)
            # A receiver that has lost a satellite may log a zero; what is no distance to a satellite is said.
            strange = np.isfinite(read) & (read != 0.0) & (np.abs(read) < 1e6)
            odd += rows[need[strange], line].tolist()
            read = np.where(np.abs(read) > 1e6, read, np.nan)
            value[need] = read
            if code != wanted[0]:
                got = need[np.isfinite(read)]
                instead[code] = instead.get(code, np.zeros(PRNS, np.int64))
                instead[code] += np.bincount(satellite[got], minlength=PRNS)
        result[epoch, satellite] = value
    kept = np.isfinite(result).any(axis=1)
    if not kept.any():
        names = " and ".join(code for code in wanted if code in listed) or wanted[0]
        raise refusal(OBSERVATION, f"holds no pseudorange of a GPS satellite: {names} without a value in every record")
    walk.notes += _told(instead, result, wanted, odd)
    return np.array(walk.stamps)[kept], np.array(walk.heads)[kept], result[kept]


def _told(
    instead: Mapping[str, NDArray[np.int64]], result: Array, wanted: tuple[str, ...], odd: list[int]
) -> list[str]:
    """Which code is read where it is not the first choice, and what is left out."""
    notes = []
    of_each = np.isfinite(result).sum(axis=0)
    for code, counts in instead.items():
        if not counts.any():
            continue
        if counts.sum() == of_each.sum():
            notes.append(f"the pseudoranges are {code}: the file has no value of {wanted[0]}")
            continue
        names = ", ".join(f"G{s + 1:02d}" for s in np.flatnonzero(counts)[:8].tolist())
        more = f" and {np.count_nonzero(counts) - 8} more" if np.count_nonzero(counts) > 8 else ""
        notes.append(
            f"{code} is read where {wanted[0]} is blank: in {counts.sum()} of {of_each.sum()} pseudoranges, of {names}"
            f"{more}"
        )
    if odd:
        notes.append(
            f"{len(odd)} value{'s' * (len(odd) > 1)} below 1000 km {'are' if len(odd) > 1 else 'is'} no distance to a "
            f"satellite and left out, the first at line {min(odd) + 1}"
        )
    return notes
