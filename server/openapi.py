"""The OpenAPI document: what FastAPI finds, plus the shape of problems and the token."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from server.problems import Problem, documented

DESCRIPTION = """Fly a scenario, break a sensor, see which test notices and what it costs in metres.

Values of signals are SI; each signal's description says in which unit a person is shown it, and the factor between.

Errors are problem details (RFC 9457). 422: the request does not fit these schemas. 409: it fits, but contradicts
itself or the experiment. Either way nothing has changed.

Live data come over the WebSocket `/api/v1/experiments/{id}/stream`, as JSON. First `hello` (experiment, signals,
history), then `frames` (time, signals: columns, new since the last), `event`, `state` (the experiment, when more than
its time has changed), `view` (diagram and scene) and `reset` (time: forget what came later). Send `subscribe`
(signals) to get frames, and `ack` (time: the last of the frames) for each: with three unacknowledged the stream
waits, and then sends what was missed thinned to its extremes. `?since=t` goes on after t (an event of t itself may
come again, by the same index); with `&history=n` of the last `hello` or `reset` it also tells of a rewind missed
meanwhile. Close codes: 4404 no such experiment, 4410 deleted, 4400 a message not understood, 4429 too many
streams or sockets, 1008 more than 50 messages a second.
"""
TAGS = {
    "systems": "what can fly, and how it describes itself",
    "scenarios": "ready documents, and their schema",
    "experiments": "scenarios in flight",
    "time": "clock, advance, rewind",
    "operator": "faults, switches, settings",
    "results": "series, events, score, replay, report",
    "server": "whether it is alive, and what runs",
}


OPEN = ("getHealth",)
"""Operations that need no token."""


def describe(app: FastAPI, guarded: bool) -> None:
    """Make the application give this document; drawn up at the first request."""

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _document(app, guarded)
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def _document(app: FastAPI, guarded: bool) -> dict[str, Any]:
    document = get_openapi(
        title=app.title,
        version=app.version,
        summary=app.summary,
        description=DESCRIPTION,
        routes=app.routes,
        tags=[{"name": name, "description": text} for name, text in TAGS.items()],
        separate_input_output_schemas=False,
    )
    components = document.setdefault("components", {})
    problem = Problem.model_json_schema(ref_template="#/components/schemas/{model}")
    schemas = components.get("schemas", {}) | problem.pop("$defs", {}) | {"Problem": problem}
    for unused in ("HTTPValidationError", "ValidationError"):
        schemas.pop(unused, None)
    components["schemas"] = _with_whole_bounds(schemas)
    document["paths"] = _with_whole_bounds(document["paths"])
    for methods in document["paths"].values():
        for operation in methods.values():
            _without_fastapis_error(operation["responses"])
            if guarded and operation["operationId"] not in OPEN:
                operation["responses"] |= {str(status): documented(status)[status] for status in (401, 429)}
                operation["security"] = [{"token": []}]
    if guarded:
        components["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
    return document


def _with_whole_bounds(value: Any) -> Any:
    """FastAPI writes the bounds of integers as floats; large ones would be read as other numbers."""
    if isinstance(value, dict):
        value = {name: _with_whole_bounds(inner) for name, inner in value.items()}
        if value.get("type") == "integer":
            value |= {name: int(bound) for name, bound in value.items() if isinstance(bound, float)}
        return value
    return [_with_whole_bounds(inner) for inner in value] if isinstance(value, list) else value


def _without_fastapis_error(responses: dict[str, Any]) -> None:
    """FastAPI documents its own 422 wherever a route has parameters; here it is a problem, or not answered at all."""
    content = responses.get("422", {}).get("content", {})
    if "HTTPValidationError" in str(content.get("application/json", {})):
        del responses["422"]
