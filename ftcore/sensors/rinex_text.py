"""Is a RINEX text whole? Walks a file record by record, and keeps what concerns GPS.

georinex takes what it can and says nothing of the rest; here every record must be complete, so that a truncated or
corrupt file is refused, by line number and never by its content. Only the code on L1 is kept: what is handed on is a
small RINEX file of the same version with one observable.
Source: RINEX 2.11 and 3.05 format descriptions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

_CODES: Final = {2: ("C1", "P1"), 3: ("C1C", "C1W", "C1P", "C1X", "C1S", "C1L", "C1Y")}
"""Code on L1, the civil one first."""
_HEADER_LINES: Final = 2000
_NAVIGATION_LINES: Final = {"G": 8, "R": 4, "E": 8, "J": 8, "C": 8, "I": 8, "S": 4}
_PACKED: Final = (b"\x1f\x8b", b"BZh", b"PK", b"\x1f\x9d", b"7z", b"\xfd7zXZ")


OBSERVATION: Final = "observation file"
NAVIGATION: Final = "navigation file"


class LogError(ValueError):
    """A log that cannot be used; the message is one sentence for a person.

    Attributes:
        part: what of the log is at fault (``observation``, ``navigation`` or ``antenna``), None if the two files
            do not fit together.
        field: the same as a place in the scenario.
    """

    def __init__(self, message: str, part: str | None = None) -> None:
        super().__init__(message)
        self.part = part
        self.field = "parameters.log" + (f".{part}" if part else "")


def refusal(what: str, problem: str) -> LogError:
    """The error that one of the two files (``OBSERVATION`` or ``NAVIGATION``) ``is`` or ``has`` something wrong."""
    return LogError(f"the {what} {problem}", what.split()[0])


@dataclass(frozen=True)
class Observations:
    """A checked observation file, reduced to one GPS observable.

    ``header``: text of a small RINEX header; ``epochs``: texts of the epochs; ``code``: the observable; ``interval``:
    of the header [s]; ``position``: approximate, Earth-fixed [m].
    """

    header: str
    epochs: tuple[str, ...]
    code: str
    interval: float | None
    position: NDArray[np.float64] | None


class _Lines:
    """Lines of a file, counted; running out of them in the middle of a record is an error."""

    def __init__(self, text: str, what: str) -> None:
        self._lines = text.splitlines()
        self.number = 0
        self.what = what

    def more(self) -> bool:
        """Whether there is anything but blank lines to come."""
        while self.number < len(self._lines) and not self._lines[self.number].strip():
            self.number += 1
        return self.number < len(self._lines)

    def next(self) -> str:
        if self.number >= len(self._lines):
            raise refusal(self.what, f"is truncated: it ends in the middle of a record, at line {self.number}")
        self.number += 1
        return self._lines[self.number - 1]

    def corrupt(self) -> LogError:
        return refusal(self.what, f"is corrupt at line {self.number}")


def decode(content: bytes, what: str) -> str:
    """The text of a file. Raises LogError for one that is empty, compressed or no text."""
    if not content.strip():
        raise refusal(what, "is empty")
    if content.startswith(_PACKED):
        raise refusal(what, "is compressed; unpack it first")
    first = content[:200].splitlines()[0]
    if b"CRINEX VERS" in first:
        raise refusal(what, "is Hatanaka-compressed; unpack it first (crx2rnx)")
    if b"RINEX VERSION / TYPE" not in first:
        raise refusal(what, "is not a RINEX file: its first line does not say so")
    try:
        return content.decode("ascii", errors="strict" if b"\0" in content else "replace")
    except UnicodeDecodeError:
        raise refusal(what, "is corrupt: it holds bytes that are no text") from None


def observations(text: str, max_epochs: int) -> Observations:
    """Walk an observation file. Raises LogError."""
    what = OBSERVATION
    lines = _Lines(text, what)
    version, header = _header(lines, "O")
    codes, wanted = _observables(header, version, lines)
    interval = _number(header.get("INTERVAL", [""])[0][:10])
    system = header.get("TIME OF FIRST OBS", [""])[0][48:51].strip()
    if system not in ("", "GPS"):
        raise refusal(what, f"keeps {system} time; only GPS time is read")
    walk = _epoch2 if version == 2 else _epoch3
    epochs = []
    while lines.more():
        epoch = walk(lines, codes, wanted)
        if epoch is not None:
            epochs.append(epoch)
        if len(epochs) > max_epochs:
            raise refusal(what, f"has more than {max_epochs} epochs, which is the most that is read")
    if not epochs:
        raise refusal(what, "holds no pseudorange of a GPS satellite")
    return Observations(_small_header(version, wanted), tuple(epochs), wanted, interval, _position(header))


def navigation(text: str) -> str:
    """Walk a navigation file and keep its header and GPS records, of several for one satellite and time the first.

    Raises LogError. (Receivers repeat a record as often as they hear it; georinex leaves out such a satellite.)
    """
    what = NAVIGATION
    lines = _Lines(text, what)
    version, _ = _header(lines, "N")
    kept = text.splitlines()[: lines.number]
    known: set[str] = set()
    while lines.more():
        first = lines.next()
        system = "G" if version == 2 else first[:1]
        if system not in _NAVIGATION_LINES:
            raise lines.corrupt()
        rows = [_navigation_row(first, lines, version, 0)]
        rows += [_navigation_row(lines.next(), lines, version, i) for i in range(1, _NAVIGATION_LINES[system])]
        satellite_and_time = rows[0][: 22 if version == 2 else 23]
        if system == "G" and satellite_and_time not in known:
            known.add(satellite_and_time)
            kept += rows
    if not known:
        raise refusal(what, "holds no ephemeris of a GPS satellite")
    return "\n".join(kept) + "\n"


def _navigation_row(line: str, lines: _Lines, version: int, place: int) -> str:
    """One line of an ephemeris with every number checked; a blank field becomes a zero, except in the last line."""
    start = (22 if version == 2 else 23) if place == 0 else (3 if version == 2 else 4)
    fields = [line[k : k + 19] for k in range(start, start + 19 * (3 if place == 0 else 4), 19)]
    if any(field.strip() and _number(field.upper().replace("D", "E")) is None for field in fields):
        raise lines.corrupt()
    if place == 0 and not line[version - 2 : start].replace("G", "").replace(".", "").replace(" ", "").isdigit():
        raise lines.corrupt()
    if place < 7:
        fields = [field.rjust(19) if field.strip() else "0.000000000000D+00".rjust(19) for field in fields]
    elif not fields[0].strip():
        raise lines.corrupt()
    return (line[:start].ljust(start) + "".join(fields)).rstrip()


def _header(lines: _Lines, kind: str) -> tuple[int, dict[str, list[str]]]:
    """Version and header lines by label."""
    first = lines.next()
    value = _number(first[:9])
    version = int(value) if value is not None else 0
    if version not in (2, 3):
        raise refusal(lines.what, f"is RINEX {first[:9].strip()[:8] or '?'}; versions 2 and 3 are read")
    names = {"O": "an observation file", "N": "a GPS navigation file"}
    if first[20:21].upper() != kind:
        other = names.get(first[20:21].upper(), "another kind of RINEX file")
        raise refusal(lines.what, f"is {other}, not {names[kind]}")
    header: dict[str, list[str]] = {}
    for _ in range(_HEADER_LINES):
        if not lines.more():
            break
        line = lines.next()
        label = line[60:].strip()
        if label == "END OF HEADER":
            return version, header
        header.setdefault(label, []).append(line[:60])
    raise refusal(lines.what, "is truncated: its header does not end")


def _observables(header: dict[str, list[str]], version: int, lines: _Lines) -> tuple[list[str], str]:
    """The observables of a GPS record in order, and the one to read."""
    codes: list[str] = []
    if version == 2:
        for row in header.get("# / TYPES OF OBSERV", []):
            codes += row[6:].split()
    else:
        for row in _of_gps(header.get("SYS / # / OBS TYPES", [])):
            codes += row[7:].split()
    for wanted in _CODES[version]:
        if wanted in codes:
            return codes, wanted
    raise refusal(lines.what, f"holds no code pseudorange of GPS on L1 ({', '.join(_CODES[version][:2])})")


def _of_gps(rows: list[str]) -> list[str]:
    kept, system = [], ""
    for row in rows:
        system = row[:1] if row[:1].strip() else system
        if system == "G":
            kept.append(row)
    return kept


def _epoch2(lines: _Lines, codes: list[str], wanted: str) -> str | None:
    """One epoch of RINEX 2 with one observable, or None for an event or an epoch without GPS."""
    head = lines.next()
    flag, count = _whole(head[28:29] or "0"), _whole(head[29:32])
    if flag is None or count is None or count < 0:
        raise lines.corrupt()
    if flag > 1:
        for _ in range(count):
            lines.next()
        return None
    if not all(_whole(head[k : k + 3]) is not None for k in (0, 3, 6, 9, 12)) or _number(head[15:26]) is None:
        raise lines.corrupt()
    names = head[32:68].ljust(36)
    for _ in range(math.ceil(count / 12) - 1):
        names += lines.next()[32:68].ljust(36)
    rows, satellites = [], []
    place = codes.index(wanted)
    for i in range(count):
        satellite = names[3 * i : 3 * i + 3]
        record = [lines.next() for _ in range(math.ceil(len(codes) / 5))]
        if _whole(satellite[1:]) is None or (not satellite[0].isalpha() and satellite[0] != " "):
            raise lines.corrupt()
        value = record[place // 5][16 * (place % 5) : 16 * (place % 5) + 14]
        if value.strip() and not _is_range(value):
            raise lines.corrupt()
        if satellite[0] in "G " and value.strip():
            satellites.append(f"G{int(satellite[1:]):02d}")
            rows.append(value)
    if not rows:
        return None
    text = f"{head[:29].ljust(29)}{len(rows):3d}{''.join(satellites[:12])}\n"
    for k in range(12, len(rows), 12):
        text += " " * 32 + "".join(satellites[k : k + 12]) + "\n"
    return text + "".join(f"{row}  \n" for row in rows)


def _epoch3(lines: _Lines, codes: list[str], wanted: str) -> str | None:
    """One epoch of RINEX 3 with one observable, or None for an event or an epoch without GPS."""
    head = lines.next()
    flag, count = _whole(head[31:32]), _whole(head[32:35])
    if not head.startswith(">") or flag is None or count is None or count < 0:
        raise lines.corrupt()
    if flag > 1:
        for _ in range(count):
            lines.next()
        return None
    if not all(_whole(head[a:b]) is not None for a, b in ((2, 6), (7, 9), (10, 12), (13, 15), (16, 18))):
        raise lines.corrupt()
    if _number(head[18:29]) is None:
        raise lines.corrupt()
    place = 3 + 16 * codes.index(wanted)
    rows = []
    for _ in range(count):
        record = lines.next()
        if not record[:1].isalpha() or _whole(record[1:3]) is None:
            raise lines.corrupt()
        value = record[place : place + 14]
        if record[0] == "G" and value.strip():
            if not _is_range(value):
                raise lines.corrupt()
            rows.append(f"G{int(record[1:3]):02d}{value}  \n")
    return f"{head[:32]}{len(rows):3d}\n" + "".join(rows) if rows else None


def _small_header(version: int, code: str) -> str:
    if version == 2:
        rows = [("     2.11           OBSERVATION DATA    G (GPS)", "RINEX VERSION / TYPE")]
        rows += [(f"     1    {code}", "# / TYPES OF OBSERV")]
    else:
        rows = [("     3.05           OBSERVATION DATA    G: GPS", "RINEX VERSION / TYPE")]
        rows += [(f"G    1 {code}", "SYS / # / OBS TYPES")]
    return "".join(f"{text:60s}{label}\n" for text, label in [*rows, ("", "END OF HEADER")])


def _position(header: dict[str, list[str]]) -> NDArray[np.float64] | None:
    numbers = [_number(word) for word in header.get("APPROX POSITION XYZ", [""])[0].split()]
    if len(numbers) != 3 or None in numbers:
        return None
    position = np.array(numbers, dtype=np.float64)
    return position if 6.3e6 < float(np.linalg.norm(position)) < 6.5e6 else None


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _is_range(field: str) -> bool:
    """Whether a field is a whole F14.3: a number cut off by the end of the file still looks like a number."""
    return len(field) == 14 and field[10] == "." and _number(field) is not None


def _whole(text: str) -> int | None:
    try:
        return int(text)
    except ValueError:
        return None
