"""What a notebook shows of a value: small pieces of HTML, and numbers with their units.

Everything that is passed in is plain text and is escaped here. No piece sets a colour of its own: text and background
are the notebook's, so that it reads in a dark and in a light one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

_PLAIN = "color:inherit;font:inherit;background:transparent"
_LINE = "1px solid rgba(128,128,128,.35)"
_CELL = f"text-align:left;vertical-align:top;padding:2px 14px 2px 0;border-bottom:{_LINE};white-space:normal"


def quantity(value: float | None, unit: str) -> str:
    """A number with its unit, four digits; a dash where there is none.

    >>> quantity(0.123456, "m"), quantity(7, "1"), quantity(None, "s")
    ('0.1235 m', '7', '–')
    """
    if value is None or math.isnan(value):
        return "–"
    return f"{value:.4g}" + (f" {unit}" if unit not in ("", "1") else "")


def table(caption: str, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; nothing where there are no rows.

    >>> "&lt;b&gt;" in table("faults", ["channel"], [["<b>"]])
    True
    """
    body = "".join(
        "<tr>" + "".join(f'<td style="{_CELL}">{escape(text)}</td>' for text in row) + "</tr>" for row in rows
    )
    if not body:
        return ""
    head = "".join(f'<th scope="col" style="{_CELL}">{escape(text)}</th>' for text in headings)
    title = f'<caption style="text-align:left;font-weight:600;padding:6px 0 2px">{escape(caption)}</caption>'
    return (
        f'<table style="border-collapse:collapse;{_PLAIN}">{title if caption else ""}'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    )


def card(title: str, about: str, *parts: str) -> str:
    """A title, a line about it, and pieces made by :func:`table` and :func:`line`."""
    said = f'<div style="opacity:.75">{escape(about)}</div>' if about else ""
    return (
        f'<div class="ftlab" style="{_PLAIN};max-width:70em;overflow-x:auto">'
        f'<div style="font-weight:600;font-size:1.1em">{escape(title)}</div>{said}{"".join(parts)}</div>'
    )


def line(text: str) -> str:
    """A line of text."""
    return f'<div style="padding:2px 0">{escape(text)}</div>' if text else ""


def counted(number: int, one: str, many: str = "") -> str:
    """A count with its noun.

    >>> counted(1, "fault"), counted(2, "fault")
    ('1 fault', '2 faults')
    """
    return f"{number} {one if number == 1 else many or one + 's'}"
