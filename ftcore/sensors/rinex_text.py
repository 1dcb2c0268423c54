"""RINEX as text: lines of a file that can be gathered by the thousand, header records, numbers, times, refusals.

A file is one array of bytes with the places where its lines begin and end; fields of many lines are cut out at once.
Whatever is wrong is said by one sentence with the line and the cause, :class:`LogError`, never by the file's content.
Source: RINEX 2.11 and 3.05 format descriptions.
"""

from __future__ import annotations

import calendar
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Lines = NDArray[np.int64]

OBSERVATION: Final = "observation file"
NAVIGATION: Final = "navigation file"
COMMENT: Final = "COMMENT"
FIRST: Final = "RINEX VERSION / TYPE"
LAST: Final = "END OF HEADER"
LABELS: Final = frozenset(
    (
        *(FIRST, LAST, "PGM / RUN BY / DATE", "MARKER NAME", "MARKER NUMBER", "MARKER TYPE", "OBSERVER / AGENCY"),
        *("REC # / TYPE / VERS", "ANT # / TYPE", "APPROX POSITION XYZ", "ANTENNA: DELTA H/E/N", "ANTENNA: DELTA X/Y/Z"),
        *("WAVELENGTH FACT L1/2", "# / TYPES OF OBSERV", "SYS / # / OBS TYPES", "SIGNAL STRENGTH UNIT", "INTERVAL"),
        *("TIME OF FIRST OBS", "TIME OF LAST OBS", "RCV CLOCK OFFS APPL", "SYS / DCBS APPLIED", "SYS / PCVS APPLIED"),
        *("SYS / SCALE FACTOR", "OBS SCALE FACTOR", "SYS / PHASE SHIFT", "SYS / PHASE SHIFTS", "GLONASS SLOT / FRQ #"),
        *("GLONASS COD/PHS/BIS", "LEAP SECONDS", "# OF SATELLITES", "PRN / # OF OBS", "ION ALPHA", "ION BETA"),
        *("DELTA-UTC: A0,A1,T,W", "IONOSPHERIC CORR", "TIME SYSTEM CORR"),
    )
)
"""Labels of header records, without comments."""
_HEADER_LINES: Final = 4000
_BLANK, _NEWLINE, _DOT, _MINUS, _PLUS, _ZERO = (ord(one) for one in " \n.-+0")
_WIDTH: Final = 14
_POWERS: Final = np.array([1e12, 1e11, 1e10, 1e9, 1e8, 1e7, 1e6, 1e5, 1e4, 1e3, 0.0, 100.0, 10.0, 1.0])
"""Weights of the places of F14.3, in thousandths; the tenth is the point."""
_GPS_EPOCH: Final = calendar.timegm((1980, 1, 6, 0, 0, 0))


class LogError(ValueError):
    """A log that cannot be used; the message is one sentence for a person.

    Attributes:
        part: what of the log is at fault (``observation``, ``navigation``, ``antenna`` or ``floor``), None if the two
            files do not fit together.
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
class Record:
    """One line of a header: its label in capitals, its 60 columns of content, its index in the file."""

    label: str
    content: str
    line: int


class Text:
    """Lines of one file.

    Attributes:
        what: which file, for messages.
        starts, ends: (lines,) where each line begins and ends in the bytes, line ends left out.
        whole: whether the last line is ended, so that it cannot have been cut off.
    """

    def __init__(self, content: bytes, what: str) -> None:
        self.what = what
        self.whole = content.endswith(b"\n")
        self._content = content
        self._bytes = np.frombuffer(content, np.uint8)
        ends = np.flatnonzero(self._bytes == _NEWLINE)
        if not self.whole:
            ends = np.append(ends, len(content))
        self.ends: Lines = ends
        self.starts: Lines = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
        self._comments = self._labelled(COMMENT)
        self._is_comment = frozenset(self._comments.tolist())

    def __len__(self) -> int:
        """How many lines."""
        return len(self.starts)

    def line(self, i: int) -> str:
        """Line ``i``, from 0 on, without its end; bytes that are no ASCII stay one character each."""
        return self._content[self.starts[i] : self.ends[i]].decode("latin-1").rstrip()

    def label(self, i: int) -> str:
        """Header label of a line, in capitals: what stands from column 61 on, '' if nothing does."""
        raw = self._content[self.starts[i] : self.ends[i]]
        text = raw.decode("ascii", "replace")
        if not raw.isascii():
            # Names with letters beyond ASCII shift the label by a column a letter, if the writer counted letters.
            text = raw.decode("utf-8", "replace")
            if len(raw) > 60 and raw[60:].isascii() and (len(raw) == 60 or raw[59:60] == b" "):
                text = " " * 60 + raw[60:].decode()
        return text[60:].strip().upper()

    def skip_blank(self, i: int) -> int:
        """First line from ``i`` on that holds anything but blanks and is no comment."""
        while i < len(self) and (not self.line(i) or self.is_comment(i)):
            i += 1
        return i

    def is_comment(self, i: int) -> bool:
        """Whether line ``i`` is a header's comment, wherever it stands."""
        return i in self._is_comment

    def records(self, first: int, count: int) -> Lines:
        """Indices of the ``count`` lines from ``first`` on that are no comments.

        Raises:
            LogError: the file ends before.
        """
        lines = np.arange(first, first + count)
        if len(self._comments):
            while (hit := np.isin(lines, self._comments)).any():
                lines = np.concatenate([lines[~hit], np.arange(lines[-1] + 1, lines[-1] + 1 + hit.sum())])
        if count and lines[-1] >= len(self):
            raise self.truncated()
        return lines

    def first_bytes(self, lines: Lines) -> NDArray[np.uint8]:
        """First byte of each of the lines, in capitals; a blank for an empty line."""
        at = np.minimum(self.starts[lines], len(self._bytes) - 1)
        first = np.where(self.starts[lines] < self.ends[lines], self._bytes[at], _BLANK)
        return np.where((first >= ord("a")) & (first <= ord("z")), first - 32, first).astype(np.uint8)

    def cut(self, lines: Lines, column: int, width: int) -> NDArray[np.uint8]:
        """Bytes ``(lines, width)`` from a column on; blanks where a line is shorter."""
        at = self.starts[lines][:, None] + np.arange(column, column + width)
        inside = at < self.ends[lines][:, None]
        return np.where(inside, self._bytes[np.minimum(at, len(self._bytes) - 1)], _BLANK).astype(np.uint8)

    def numbers(self, lines: Lines, column: int, name: str) -> Array:
        """Fields F14.3 of many lines at one column, (lines,); NaN where a field is blank.

        A whole field has its point at the eleventh place: a number that was cut off still looks like a number.

        Raises:
            LogError: a field that is none, by its line.
        """
        field = self.cut(lines, column, _WIDTH)
        blank = (field == _BLANK).all(axis=1)
        digit = (field >= _ZERO) & (field <= _ZERO + 9)
        sign = (field == _MINUS) | (field == _PLUS)
        started = np.logical_or.accumulate(field != _BLANK, axis=1)
        first = started & ~np.pad(started, ((0, 0), (1, 0)))[:, :-1]
        fits = digit | (~started) | (first & sign)
        fits[:, 10] = field[:, 10] == _DOT
        fits[:, 11:] = digit[:, 11:]
        wrong = ~blank & ~fits.all(axis=1)
        if wrong.any():
            line = int(lines[wrong.argmax()])
            if line == len(self) - 1 and not self.whole:
                raise self.truncated()
            raise self.corrupt(line, f"its {name} is not a number of the form F14.3")
        # Whole thousandths are exact, so this is the double nearest to what is written.
        size = np.where(digit, field - _ZERO, 0).astype(np.float64) @ _POWERS / 1e3
        negative = (field == _MINUS).any(axis=1)
        return np.where(blank, np.nan, np.where(negative, -size, size))

    def header(self, first: int = 0) -> tuple[list[Record], int]:
        """Records of a header that begins at line ``first``, without comments, and the line after its end.

        Raises:
            LogError: the header does not end.
        """
        records: list[Record] = []
        for i in range(first, min(first + _HEADER_LINES, len(self))):
            record = self.record(i)
            if record.label == LAST:
                return records, i + 1
            if record.label != COMMENT:
                records.append(record)
        raise refusal(self.what, "is truncated: its header does not end")

    def record(self, i: int) -> Record:
        """Line ``i`` as a line of a header."""
        return Record(self.label(i), self.line(i)[:60].ljust(60), i)

    def truncated(self) -> LogError:
        """It ends in the middle of something."""
        return refusal(self.what, f"is truncated: it ends in the middle of a record, at line {len(self)}")

    def corrupt(self, line: int, cause: str) -> LogError:
        """A line, from 0 on, that cannot be what must stand there."""
        return refusal(self.what, f"is corrupt at line {line + 1}: {cause}")

    def _labelled(self, label: str) -> Lines:
        """Lines that have this header label."""
        bytes_ = label.encode()
        long = np.flatnonzero(self.ends - self.starts >= 60 + len(bytes_))
        for k, letter in enumerate(bytes_):
            found = self._bytes[self.starts[long] + 60 + k] | 32
            long = long[found == letter | 32]
        return long


def version_of(record: Record, what: str, kind: str) -> float:
    """The format version in the first record of a file or of a header inside one.

    Args:
        kind: O or N, the file type that is wanted.

    Raises:
        LogError: another version or another kind of file.
    """
    value = number(record.content[:9])
    major = int(value) if value is not None else 0
    if value is None or major not in (2, 3):
        given = record.content[:9].strip()[:8]
        shown = given if given.isascii() and given.replace(".", "").isdigit() else "?"
        raise refusal(what, f"is RINEX {shown}; versions 2 and 3 are read")
    found = record.content[20:21].upper()
    if found != kind:
        names = {
            "O": "an observation file",
            "N": "a GPS navigation file",
            "G": "a GLONASS navigation file, another kind of RINEX file",
            "H": "an SBAS navigation file, another kind of RINEX file",
            "M": "a meteorological file, another kind of RINEX file",
            "C": "a clock file, another kind of RINEX file",
        }
        raise refusal(what, f"is {names.get(found, 'another kind of RINEX file')}, not {names[kind]}")
    return value


def seconds_of(parts: Iterable[str], short_year: bool) -> float | None:
    """Year, month, day, hour, minute and second as they stand in a file, as seconds of the continuous GPS time scale.

    A second, minute or hour that is full (60, 60, 24), as converters write what they have rounded up, is the next one.
    None if it is no time at all.
    """
    *fields, last = parts
    numbers = [whole(field) for field in fields]
    second = number(last)
    if second is None or any(value is None for value in numbers):
        return None
    year, month, day, hour, minute = (int(value) for value in numbers if value is not None)
    if short_year:
        year += 1900 if 80 <= year <= 99 else 2000 if 0 <= year < 80 else 0
    if not (1980 <= year <= 2100 and 1 <= month <= 12 and 1 <= day <= calendar.monthrange(year, month)[1]):
        return None
    if not (0 <= hour <= 24 and 0 <= minute <= 60 and 0.0 <= second <= 60.0):
        return None
    days = calendar.timegm((year, month, day, 0, 0, 0)) - _GPS_EPOCH
    return days + 3600.0 * hour + 60.0 * minute + second


def date(seconds: float) -> str:
    """A moment of the GPS time scale for a person."""
    moment = np.datetime64("1980-01-06T00:00:00", "ms") + np.timedelta64(round(float(seconds) * 1000.0), "ms")
    return str(moment.astype("datetime64[s]")).replace("T", " ")


def number(text: str) -> float | None:
    """A finite number in either of Fortran's exponents, None if it is none."""
    text = text.strip()
    if not text or not set(text) <= set("+-.0123456789eEdD"):
        return None
    try:
        value = float(text.replace("D", "E").replace("d", "e"))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def whole(text: str) -> int | None:
    """A whole number, None if it is none."""
    text = text.strip()
    return int(text) if text.isascii() and text.removeprefix("-").isdigit() else None


def place(content: str) -> Array | None:
    """Three coordinates of a header record, (3,) [m]; None where they are no point near the Earth's surface."""
    numbers = [number(word) for word in content.split()]
    if len(numbers) != 3 or None in numbers:
        numbers = [number(content[k : k + 14]) for k in (0, 14, 28)]
    if None in numbers:
        return None
    position = np.array(numbers, dtype=np.float64)
    return position if 6.3e6 < float(np.linalg.norm(position)) < 6.5e6 else None
