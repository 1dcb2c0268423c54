"""Counts with their denominators, intervals and words."""

from __future__ import annotations

from ftcore.score import intervals
from ftcore.score.models import Share


def share(count: int, of: int, what: str) -> Share:
    """So many of so many; ``what`` names the denominator, for instance "runs in which it acted"."""
    if of == 0:
        return Share(count=0, of=0, share=None, low=None, high=None, words=f"there are no {what}")
    low, high = intervals.of_share(count, of)
    words = f"{count} of {of} {what}"
    if of > 1:
        words += f" ({intervals.between(low, high)})"
    return Share(count=count, of=of, share=count / of, low=low, high=high, words=words)


def number(count: int, one: str, many: str) -> str:
    """A count with its noun."""
    return f"{count} {one if count == 1 else many}"
