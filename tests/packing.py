"""RINEX files packed as people keep them."""

from __future__ import annotations

import bz2
import gzip
import io

import hatanaka
import ncompress


def packed(content: bytes, how: str) -> bytes:
    """``content`` packed as by the endings ``how``, for instance ``crx.gz``; others than these are left alone."""
    for ending in how.split("."):
        if ending == "crx":
            content = hatanaka.rnx2crx(content)
        elif ending == "gz":
            content = gzip.compress(content)
        elif ending == "bz2":
            content = bz2.compress(content)
        elif ending == "Z":
            sink = io.BytesIO()
            ncompress.compress(content, sink)
            content = sink.getvalue()
    return content
