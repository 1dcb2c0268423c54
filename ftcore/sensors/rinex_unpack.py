"""Contents of a file as it was kept or sent, to plain RINEX text: unpacked, with one kind of line end.

gzip, bzip2, Unix compress (.Z) and Hatanaka's compact RINEX (.crx) may be nested. What comes out is bounded: a small
file that unpacks to gigabytes is stopped at the limit, not at the end of the memory.
Sources: Y. Hatanaka, Bulletin of GSI 55 (2008), by the package hatanaka; .Z by the package ncompress.
"""

from __future__ import annotations

import bz2
import codecs
import io
import re
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Final

import ncompress

from ftcore.sensors.rinex_text import FIRST, refusal

_OTHERS: Final = (
    (b"PK\x03\x04", "zip"),
    (b"7z\xbc\xaf", "7-Zip"),
    (b"\xfd7zXZ", "xz"),
    (b"\x28\xb5\x2f\xfd", "Zstandard"),
)
_MARKS: Final = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_LAYERS: Final = 4
_CHUNK: Final = 1 << 20
_PATIENCE: Final = 60.0
"""How long compact RINEX may take to unpack [s]."""


def unpack(content: bytes, what: str, most: int) -> bytes:
    """Plain text of a file: lines that end in a newline only, without byte order marks.

    Args:
        what: which file, for messages.
        most: bytes that may come out of it.

    Raises:
        LogError: it is empty, no RINEX file, packed in a way that is not read, damaged, or larger than ``most``.
    """
    for _ in range(_LAYERS):
        if not content.strip(b"\0\x1a \t\r\n"):
            raise refusal(what, "is empty")
        layer = _layer(content, what)
        if layer is None:
            break
        name, opened = layer
        try:
            content = opened(content, most)
        except _TooLarge:
            raise refusal(what, f"unpacks to more than {most / 1e6:.0f} MB, the most that is read") from None
        except (EOFError, OSError, ValueError, RuntimeError, zlib.error) as error:
            told = f": {error}" if isinstance(error, _Damaged) else ""
            raise refusal(what, f"is corrupt: its {name} packing is damaged or cut off{told}") from None
    else:
        raise refusal(what, f"is packed more than {_LAYERS - 1} times")
    if len(content) > most:
        raise refusal(what, f"has {len(content) / 1e6:.1f} MB; at most {most / 1e6:.0f} MB are read")
    return _plain(content, what)


class _TooLarge(Exception):
    """More comes out than may."""


class _Damaged(ValueError):
    """Something a packer says for itself, fit for a message."""


class _Bounded(io.RawIOBase):
    """Keeps what is written to it, up to a limit."""

    def __init__(self, most: int) -> None:
        self.parts: list[bytes] = []
        self.size = 0
        self._most = most

    def writable(self) -> bool:
        return True

    def write(self, part: object) -> int:
        piece = bytes(memoryview(part))  # type: ignore[arg-type]
        self.size += len(piece)
        if self.size > self._most:
            raise _TooLarge
        self.parts.append(piece)
        return len(piece)


def _layer(content: bytes, what: str) -> tuple[str, Callable[[bytes, int], bytes]] | None:
    """Name of the outermost packing and what opens it; None for plain text."""
    if content.startswith(b"\x1f\x8b"):
        return "gzip", _gunzip
    if content.startswith(b"BZh"):
        return "bzip2", _bunzip
    if content.startswith(b"\x1f\x9d"):
        return "compress (.Z)", _uncompress
    for magic, name in _OTHERS:
        if content.startswith(magic):
            raise refusal(what, f"is compressed by {name}; gzip, bzip2, .Z and .crx are read, unpack others first")
    if b"CRINEX VERS" in content[:200].upper():
        return "Hatanaka", _restore
    return None


def _gunzip(content: bytes, most: int) -> bytes:
    sink = _Bounded(most)
    while content[:2] == b"\x1f\x8b":
        member = zlib.decompressobj(wbits=31)
        while not member.eof:
            piece = member.decompress(content, _CHUNK)
            content = member.unconsumed_tail
            sink.write(piece)
            if not piece and not content and not member.eof:
                raise EOFError
        content = member.unused_data
    return b"".join(sink.parts)


def _bunzip(content: bytes, most: int) -> bytes:
    sink = _Bounded(most)
    while content[:3] == b"BZh":
        member = bz2.BZ2Decompressor()
        while not member.eof:
            piece = member.decompress(content, _CHUNK)
            content = b""
            sink.write(piece)
            if not piece and not member.eof and member.needs_input:
                raise EOFError
        content = member.unused_data
    return b"".join(sink.parts)


def _uncompress(content: bytes, most: int) -> bytes:
    sink = _Bounded(most)
    try:
        ncompress.decompress(content, sink)
    except Exception:
        # What the sink raised may come back as another exception: that it is full decides.
        if sink.size > most:
            raise _TooLarge from None
        raise
    return b"".join(sink.parts)


def _restore(content: bytes, most: int) -> bytes:
    """Compact RINEX by the program of the package hatanaka, read only as far as may be."""
    program = resources.files("hatanaka.bin") / ("crx2rnx.exe" if sys.platform == "win32" else "crx2rnx")
    content = content.replace(b"\r\n", b"\n")
    with (
        resources.as_file(program) as path,
        tempfile.TemporaryFile() as packed,
        tempfile.TemporaryFile() as told,
        tempfile.TemporaryFile() as plain,
    ):
        packed.write(content)
        packed.seek(0)
        with subprocess.Popen([str(Path(path)), "-"], stdin=packed, stdout=subprocess.PIPE, stderr=told) as process:
            assert process.stdout is not None
            size = 0
            while piece := process.stdout.read(_CHUNK):
                size += len(piece)
                if size > most:
                    process.kill()
                    raise _TooLarge
                plain.write(piece)
            status = process.wait(_PATIENCE)
        if status not in (0, 2):  # 2: warnings only
            told.seek(0)
            line = re.search(rb"line[^0-9]{0,9}([0-9]+)", told.read(2000))
            raise _Damaged(f"crx2rnx stops at line {int(line[1])}" if line else "crx2rnx refuses it")
        plain.seek(0)
        return plain.read()


def _plain(content: bytes, what: str) -> bytes:
    for mark, encoding in _MARKS:
        if content.startswith(mark):
            try:
                content = content.decode(encoding).encode("ascii", "replace")
            except UnicodeDecodeError:
                raise refusal(what, f"is corrupt: it is not the {encoding.upper()} text that it says") from None
            break
    content = content.replace(codecs.BOM_UTF8, b"")
    if b"\r" in content:
        content = content.replace(b"\r\r\n", b"\n").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    content = content.rstrip(b"\x1a")
    first = content[:400].lstrip(b"\n").split(b"\n")[0]
    if FIRST.encode() not in first.upper():
        raise refusal(what, "is not a RINEX file: its first line does not say so")
    if b"\0" in content:
        line = content[: content.index(b"\0")].count(b"\n") + 1
        raise refusal(what, f"is corrupt at line {line}: it holds bytes that are no text")
    return content
