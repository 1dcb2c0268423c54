"""What a flight gave: series, events, score, the document that replays it, a report."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from ftcore import Scenario
from ftcore.description import View
from ftcore.documents import Seconds
from ftcore.score import Score
from server import negotiation, report, series
from server.dependencies import Live
from server.models import Cursor, EventState, Series
from server.problems import Refused, at, documented
from server.security import REPORT_POLICY

router = APIRouter(prefix="/experiments/{id}", tags=["results"])
JSON, CSV, PARQUET = "application/json", "text/csv", "application/vnd.apache.parquet"


class SeriesQuery(BaseModel):
    """Which columns, of which time, how fine."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    signals: str | None = Field(
        default=None,
        max_length=16_000,
        pattern=r"^[A-Za-z0-9_.+, \-]*$",
        description="names, separated by commas; all if absent",
    )
    start: Seconds | None = Field(default=None, description="from this time on [s]")
    end: Seconds | None = Field(default=None, description="up to this time [s]")
    points: int | None = Field(
        default=None, ge=2, le=100_000, description="about how many rows, keeping extremes; JSON only"
    )


class ViewQuery(BaseModel):
    """Which moment."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    at: Seconds | None = Field(default=None, description="time [s]; now if absent")


@router.get(
    "/series",
    operation_id="getSeries",
    summary="Recorded signals",
    response_model=Series,
    responses=documented(404, 406, 422)
    | {
        200: {
            "description": "Columns, SI. CSV and Parquet hold the same columns at full resolution.",
            "content": {
                CSV: {"schema": {"type": "string"}},
                PARQUET: {"schema": {"type": "string", "format": "binary"}},
            },
        }
    },
)
async def get_series(query: Annotated[SeriesQuery, Query()], experiment: Live, request: Request) -> Response:
    """Columns as JSON, or everything as CSV or Parquet by ``Accept``. SI units; ``null`` or NaN where there is none."""
    accept = request.headers.get("accept", "*/*")
    kind = negotiation.choose(accept, (JSON, CSV, PARQUET))
    if kind is None:
        raise Refused(406, f"series can be had as {JSON}, {CSV} or {PARQUET}, not as {accept}")
    names = None if query.signals is None else [name.strip() for name in query.signals.split(",") if name.strip()]
    known = experiment.signals
    for name in names or ():
        if name not in known:
            close = negotiation.near(name, known)
            detail = f"no signal {name!r}" + (f"; do you mean {', '.join(close)}?" if close else "")
            raise Refused(404, detail, [at(["signals"], detail, close or None, source="query")])
    if kind == JSON:
        wanted = sorted(known) if names is None else list(dict.fromkeys(names))
        found = await experiment.read(lambda s: series.columns(s, wanted, query.start, query.end, query.points))
        return Response(await asyncio.to_thread(found.json), media_type=JSON)
    table = await experiment.read(lambda s: series.table(s, names, query.start, query.end))
    write, suffix = (series.csv, "csv") if kind == CSV else (series.parquet, "parquet")
    return Response(
        await asyncio.to_thread(write, table),
        media_type=kind,
        headers={"content-disposition": f'attachment; filename="ftlab-{experiment.id}.{suffix}"', "vary": "accept"},
    )


@router.get("/events", operation_id="listEvents", summary="What happened", responses=documented(404))
async def list_events(experiment: Live) -> list[EventState]:
    """All events, in order."""
    return await experiment.read(
        lambda s: [EventState.model_validate(event, from_attributes=True) for event in s.events]
    )


@router.get("/score", operation_id="getScore", summary="The flight against the truth", responses=documented(404))
async def get_score(experiment: Live) -> Score:
    """Delays of detection and isolation, false alarms, errors, consistency."""
    return await experiment.read(lambda simulation: simulation.score())


@router.get("/scenario", operation_id="getReplay", summary="What was run", responses=documented(404))
async def get_replay(experiment: Live) -> Scenario:
    """The scenario with every command so far. Posted again and advanced, it gives the same bits."""
    return await experiment.read(lambda simulation: simulation.document())


@router.get(
    "/view", operation_id="getView", summary="Diagram and scene at a moment", responses=documented(404, 409, 422)
)
async def get_view(query: Annotated[ViewQuery, Query()], experiment: Live) -> View:
    """State of every block and scene item, now or at an earlier moment."""
    if query.at is None:
        return await experiment.view()
    return await experiment.read(lambda simulation: simulation.view(query.at))


@router.put(
    "/cursor",
    operation_id="setCursor",
    summary="Move the 3-D scene in time",
    responses=documented(400, 404, 409, 413, 415, 422),
)
async def set_cursor(body: Cursor, experiment: Live) -> Cursor:
    """The scene shows this moment and this picture until it is given others; time null: live."""
    await experiment.show(body.time, body.picture)
    return body


@router.get(
    "/report",
    operation_id="getReport",
    summary="One page that says it all",
    response_class=Response,
    responses=documented(404)
    | {200: {"description": "A self-contained page", "content": {"text/html": {"schema": {"type": "string"}}}}},
)
async def get_report(experiment: Live) -> Response:
    """Plots, events, score and scenario in one HTML file that needs nothing else."""

    facts = await experiment.read(lambda simulation: report.gather(simulation, experiment.title))
    page = await asyncio.to_thread(report.render, facts)
    return Response(
        page,
        media_type="text/html",
        headers={
            "content-security-policy": REPORT_POLICY,
            "content-disposition": f'inline; filename="ftlab-{experiment.id}.html"',
        },
    )
