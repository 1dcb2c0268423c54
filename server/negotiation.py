"""Small courtesies: the media type a client likes best, and names that are nearly right."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


def choose(accept: str, offered: Sequence[str]) -> str | None:
    """The offered media type that an Accept header likes best, the first of equals; None if it likes none."""
    ranges = [_parsed(part) for part in accept.split(",") if part.strip()] or [("*/*", 1.0)]
    best, most = None, 0.0
    for kind in offered:
        fitting = [
            (len(pattern) - 2 * pattern.count("*"), quality) for pattern, quality in ranges if _fits(pattern, kind)
        ]
        quality = max(fitting)[1] if fitting else 0.0
        if quality > most:
            best, most = kind, quality
    return best


def near(name: str, known: Iterable[str]) -> list[str]:
    """Known names that resemble ``name``, the nearest first."""
    return difflib.get_close_matches(name, sorted(known), n=6, cutoff=0.5)


def _parsed(part: str) -> tuple[str, float]:
    kind, *parameters = [piece.strip() for piece in part.split(";")]
    quality = 1.0
    for parameter in parameters:
        key, _, value = parameter.partition("=")
        if key.strip().lower() == "q":
            try:
                quality = float(value)
            except ValueError:
                quality = 0.0
    return kind.lower(), quality


def _fits(pattern: str, kind: str) -> bool:
    return pattern in ("*/*", "*") or pattern == kind or (pattern.endswith("/*") and kind.startswith(pattern[:-1]))
