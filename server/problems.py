"""Errors as RFC 9457 problem details: what was wrong, where, and what would be right.

Two refusals are kept apart. **422**: the request does not fit the published schema. **409**: it fits, but contradicts
itself or this experiment (no such channel here, an end before its start, a time outside the flight). Either way nothing
has changed.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Container, Iterable, Sequence
from http import HTTPStatus
from itertools import islice
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.exceptions import HTTPException
from starlette.routing import Match

from ftcore.catalogue import CatalogueError
from ftcore.faults import FaultError
from ftcore.simulation import CommandError
from server.acceptance import accepted_fields, place

MEDIA_TYPE = "application/problem+json"
_LOCATIONS = ("body", "query", "path", "header", "cookie")
_log = logging.getLogger("ftlab")


class FieldError(BaseModel):
    """One thing that is wrong with a request."""

    field: str = Field(description="dotted path of the field, or name of the parameter")
    pointer: str | None = Field(default=None, description="JSON Pointer into the body, as a URI fragment")
    parameter: str | None = Field(default=None, description="name of the query, path or header parameter")
    detail: str = Field(description="what is wrong, and what would be accepted")
    accepted: list[str] | None = Field(default=None, description="the names or values that would be accepted, if few")


INTERNAL_FAILURE = "urn:ftlab:problem:internal-failure"
"""Type of the problem that FTLab itself failed in a flight: no request is at fault."""


class Problem(BaseModel):
    """RFC 9457 problem details."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "type": "about:blank",
                "title": "Conflict",
                "status": 409,
                "detail": "gps.pseudorange.C1 does not take 'spin'; it takes bias, ramp",
                "errors": [{"field": "kind", "pointer": "#/kind", "detail": "gps.pseudorange.C1 does not take 'spin'"}],
            }
        }
    )

    type: str = Field(
        default="about:blank", description=f"about:blank: the status says it all; {INTERNAL_FAILURE}: FTLab failed"
    )
    title: str
    status: int
    detail: str
    errors: list[FieldError] = Field(default_factory=list)


class Refused(Exception):
    """A request that cannot be done; becomes a problem response."""

    def __init__(
        self,
        status: int,
        detail: str,
        errors: Sequence[FieldError] = (),
        headers: dict[str, str] | None = None,
        type: str = "about:blank",
    ) -> None:
        super().__init__(detail)
        self.type = type
        self.status = status
        self.detail = detail
        self.errors = list(errors)
        self.headers = headers or {}


def problem(
    status: int,
    detail: str,
    errors: Sequence[FieldError] = (),
    headers: dict[str, str] | None = None,
    type: str = "about:blank",
) -> Response:
    """A problem response."""
    title = "Internal failure" if type == INTERNAL_FAILURE else HTTPStatus(status).phrase
    body = Problem(type=type, title=title, status=status, detail=detail, errors=list(errors))
    # What was sent may be quoted in it, and may hold halves of surrogate pairs: `json` spells them, UTF-8 cannot.
    content = json.dumps(body.model_dump(exclude_none=True))
    return Response(content, status_code=status, media_type=MEDIA_TYPE, headers=headers)


_MEANING = {
    400: "The body cannot be read as what it is said to be.",
    401: "A token is needed.",
    403: "The Host or Origin is not one of this server's.",
    404: "There is nothing of that name.",
    406: "None of the media types asked for can be given.",
    409: "Well-formed, but it contradicts itself or the state of the experiment. Nothing has changed.",
    408: "The body did not come in time.",
    410: "It was deleted meanwhile.",
    413: "The body is too large.",
    415: "The body is not sent as the media type that is wanted.",
    422: "The request does not fit the schema. Nothing has changed.",
    429: "A limit of this server is reached.",
    503: "The server is being stopped.",
}


def documented(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """OpenAPI ``responses`` for the errors a route may answer, on top of those every route may."""
    return {
        status: {
            "description": _MEANING[status],
            "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
        }
        for status in sorted({403, 422, *statuses, *((408,) if 413 in statuses else ())})
    }


def pointer(location: Iterable[Any]) -> str:
    """JSON Pointer (RFC 6901) of a location, as a URI fragment."""
    return "#" + "".join("/" + str(part).replace("~", "~0").replace("/", "~1") for part in location)


def at(location: Sequence[Any], detail: str, accepted: list[str] | None = None, source: str = "body") -> FieldError:
    """What is wrong at a location of the body, or with a parameter of another source."""
    field = ".".join(map(str, location))
    if source == "body":
        return FieldError(field=field, pointer=pointer(location), detail=detail, accepted=accepted)
    return FieldError(field=field, parameter=field, detail=detail, accepted=accepted)


MOST_ERRORS = 20
"""How many things that are wrong with one request are told; a document can be wrong in a hundred thousand places."""


def field_errors(
    errors: Iterable[Any], given: Any, form: Any = None, prefix: Sequence[Any] = (), source: str = "body"
) -> list[FieldError]:
    """Pydantic's errors as field errors, one for each place.

    Args:
        errors: what pydantic said.
        given: what was validated.
        form: the annotation it was validated against, if known.
        prefix: where ``given`` stands in the body.
        source: body, query or path.
    """
    found: dict[tuple[Any, ...], FieldError] = {}
    for error in islice(errors, 5 * MOST_ERRORS):
        inner = place(error["loc"], given) or _named_in(str(error["msg"]), form)
        detail, accepted = _in_words(error, inner, form)
        location = (*prefix, *inner)
        if location in found and detail != found[location].detail:
            detail = f"{found[location].detail}; or {detail}"
        found[location] = at(location, detail, accepted, source)
    return list(found.values())[:MOST_ERRORS]


_PLAIN = {
    "greater_than": "more than {gt} is needed",
    "greater_than_equal": "at least {ge} is needed",
    "less_than": "less than {lt} is needed",
    "less_than_equal": "at most {le} is taken",
    "finite_number": "a finite number is needed",
    **dict.fromkeys(("float_type", "float_parsing"), "a number is needed"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number is needed"),
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false is needed"),
    "string_type": "a text is needed",
    "string_too_short": "a text of at least {min_length} characters is needed",
    "string_too_long": "a text of at most {max_length} characters is needed",
    **dict.fromkeys(("list_type", "tuple_type"), "a list is needed"),
    "too_short": "at least {min_length} items are needed",
    "too_long": "at most {max_length} items are taken",
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), "an object with named fields is needed"),
}
"""What pydantic says of a value, in plain words; whatever else it says is passed on."""


def _in_words(error: Any, location: Sequence[Any], form: Any) -> tuple[str, list[str] | None]:
    """What is wrong and what would be right, and the accepted names if that is what is wrong."""
    detail = str(error["msg"]).removeprefix("Value error, ")
    if error["type"] == "extra_forbidden":
        fields = accepted_fields(form, location[:-1])
        return f"there is no field {location[-1]!r}" + (f"; accepted are {', '.join(fields)}" if fields else ""), fields
    if error["type"] == "missing":
        return f"{location[-1]!r} is needed" if location else "a body is needed", None
    if error["type"] in ("literal_error", "enum"):
        return f"{_shown(error.get('input'))} is not accepted; {error['ctx']['expected']} is", None
    if error["type"] in _PLAIN:
        bounds = {name: f"{v:g}" if isinstance(v, float) else v for name, v in error.get("ctx", {}).items()}
        detail = _PLAIN[error["type"]].format(**bounds)
    if error.get("input") is not None and not isinstance(error["input"], dict | list):
        return f"{detail}, not {_shown(error['input'])}", None
    return detail, None


def _named_in(message: str, form: Any) -> tuple[Any, ...]:
    """The field that a rule on the whole document speaks of: the one its sentence begins with, if there is one."""
    first = message.removeprefix("Value error, ").split(" ", 1)[0]
    return (first,) if first in (accepted_fields(form, ()) or ()) else ()


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def from_validation(
    error: ValidationError, given: Any, form: Any, prefix: Sequence[Any] = (), free: Container[str] = ()
) -> Refused:
    """The refusal for a document that pydantic refused: 422 against the schema, 409 against the rules beyond it.

    Args:
        error: what pydantic said.
        given: the document.
        form: what it should be.
        prefix: where the document stands in the body.
        free: fields of which the published schema says nothing.
    """
    errors = error.errors(include_url=False)
    beyond = all(e["type"] == "value_error" or (e["loc"] and e["loc"][0] in free) for e in errors)
    status = 409 if beyond else 422
    found = field_errors(errors, given, form, prefix)
    return Refused(status, _summary(found), found)


def _summary(errors: Sequence[FieldError]) -> str:
    if not errors:
        return "the request cannot be taken"
    first = errors[0]
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    # A rule on several fields names them itself.
    detail = (
        first.detail if not first.field or first.detail.startswith(first.field) else f"{first.field}: {first.detail}"
    )
    return f"{detail}{more}"


def install(app: FastAPI) -> None:
    """Make every error of the application a problem response."""
    app.add_exception_handler(Refused, _refused)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(CommandError, _command_refused)
    app.add_exception_handler(FaultError, _command_refused)
    app.add_exception_handler(CatalogueError, _unknown)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(Exception, _defect)


async def _refused(_: Request, error: Exception) -> Response:
    assert isinstance(error, Refused)
    return problem(error.status, error.detail, error.errors, error.headers, error.type)


async def _command_refused(_: Request, error: Exception) -> Response:
    field = str(getattr(error, "field", ""))
    return problem(409, str(error), [at(field.split("."), str(error))])


async def _unknown(_: Request, error: Exception) -> Response:
    return problem(404, str(error.args[0] if error.args else error))


async def _invalid(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    errors = error.errors()
    if any(e["type"] == "json_invalid" for e in errors):
        first = errors[0]
        reason = first.get("ctx", {}).get("error", "it ends too early")
        return problem(400, f"the body is not JSON: {reason} at character {first['loc'][-1]}")
    route = request.scope.get("route")
    body_field = getattr(route, "body_field", None)
    form = body_field.field_info.annotation if body_field is not None else None
    found: list[FieldError] = []
    for source in _LOCATIONS:
        these = [{**e, "loc": tuple(e["loc"][1:])} for e in errors if e["loc"] and e["loc"][0] == source]
        if source == "body":
            found += field_errors(these, error.body, form)
        else:
            parameters = request.path_params if source == "path" else dict(request.query_params)
            found += field_errors(these, parameters, source=source)
    status = 409 if errors and all(e["type"] == "value_error" for e in errors) else 422
    return problem(status, _summary(found), found)


async def _http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    detail = str(error.detail)
    if error.status_code == 404:
        detail = f"there is nothing at {request.url.path}; /docs lists what there is"
    elif error.status_code == 405:
        allowed = _allowed_methods(request)
        headers["Allow"] = ", ".join(allowed)
        detail = f"{request.method} cannot be done to {request.url.path}; {', '.join(allowed)} can"
    elif error.status_code == 408:
        detail = "the rest of the body did not come in time"
    elif error.status_code == 413:
        detail = "the body is larger than this server takes"
    elif error.status_code == 400:
        detail = "the body is not JSON that can be read"
    return problem(error.status_code, detail, headers=headers)


def _allowed_methods(request: Request) -> list[str]:
    """Methods of every route at the request's path; a single route knows only its own."""
    return [
        method
        for method in ("DELETE", "GET", "HEAD", "PATCH", "POST", "PUT")
        if any(route.matches({**request.scope, "method": method})[0] is Match.FULL for route in request.app.routes)
    ]


async def _defect(request: Request, error: Exception) -> Response:
    _log.exception("%s %s failed", request.method, request.url.path, exc_info=error)
    return problem(500, "this is a defect of FTLab; the server's log says more")
