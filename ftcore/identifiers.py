"""Ids and names: what documents may call things, so that no path, file or report is bent by it.

An id stands in URLs, in addresses of noise, in file names and in logs. So it has no dot (a client resolves ``.`` and
``..`` before it sends them), no slash, no percent sign, no space and nothing that a shell or a browser reads.
"""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

ID_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,59}$"
NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_+-]*(\.[A-Za-z0-9][A-Za-z0-9_+-]*)*$"
LINE_PATTERN = r"^[^\u0000-\u001f\u007f-\u009f\u2028-\u202e\u2066-\u2069]*$"
TEXT_PATTERN = r"^[^\u0000-\u0008\u000b-\u001f\u007f-\u009f\u202a-\u202e\u2066-\u2069]*$"

_ID, _NAME, _LINE, _TEXT = (re.compile(p[:-1] + r"\Z") for p in (ID_PATTERN, NAME_PATTERN, LINE_PATTERN, TEXT_PATTERN))


def _id(value: str) -> str:
    if not _ID.match(value):
        raise PydanticCustomError(
            "identifier", "an id has 1 to 60 letters (a-z, A-Z), digits, - and _, and begins with a letter or a digit"
        )
    return value


def _name(value: str) -> str:
    if not _NAME.match(value) or len(value) > 80:
        raise PydanticCustomError(
            "identifier", "a name has at most 80 letters (a-z, A-Z), digits, -, _ and +, in words joined by single dots"
        )
    return value


def _whole(value: str) -> bool:
    """Whether every character is one: JSON can spell half of a surrogate pair, which nothing can write down again."""
    return not any("\ud800" <= character <= "\udfff" for character in value)


def _line(value: str) -> str:
    if not (_LINE.match(value) and _whole(value)):
        raise PydanticCustomError("one_line", "this is one line of text, without control characters")
    return value


def _text(value: str) -> str:
    if not (_TEXT.match(value) and _whole(value)):
        raise PydanticCustomError("plain_text", "this is text without control characters other than line breaks")
    return value


Id = Annotated[
    str, AfterValidator(_id), Field(json_schema_extra={"pattern": ID_PATTERN, "minLength": 1, "maxLength": 60})
]
"""What a document, an operator or a client calls a thing: a fault, later a campaign or an expectation."""

Name = Annotated[str, AfterValidator(_name), Field(json_schema_extra={"pattern": NAME_PATTERN, "maxLength": 80})]
"""What a system calls a channel, a subsystem or a signal: words joined by dots."""

Line = Annotated[str, AfterValidator(_line), Field(json_schema_extra={"pattern": LINE_PATTERN})]
"""A title: one line, which a terminal, a report and a header can show as it is."""

Text = Annotated[str, AfterValidator(_text), Field(json_schema_extra={"pattern": TEXT_PATTERN})]
"""A paragraph: line breaks and tabs, but no other control character."""
