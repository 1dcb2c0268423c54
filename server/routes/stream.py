"""The live stream."""

from __future__ import annotations

import math

from fastapi import APIRouter, WebSocket

from server.dependencies import LiveSocket
from server.settings import Settings
from server.stream import BAD_MESSAGE, BUSY, UNKNOWN, Viewer

router = APIRouter()


@router.websocket("/experiments/{id}/stream")
async def stream(socket: WebSocket, experiment: LiveSocket) -> None:
    """Hello, then frames, events, state, view and resets, as long as both sides want."""
    await socket.accept()
    settings: Settings = socket.app.state.settings
    since = _seconds(socket.query_params.get("since"))
    history = _count(socket.query_params.get("history"))
    if experiment is None:
        await socket.close(UNKNOWN, "no such experiment")
    elif since is not None and not (math.isfinite(since) and since >= 0.0):
        await socket.close(BAD_MESSAGE, "since must be a time in seconds, not negative")
    elif len(experiment.subscribers) >= settings.streams_per_experiment:
        await socket.close(BUSY, f"{settings.streams_per_experiment} streams watch this experiment already")
    else:
        await Viewer(socket, experiment, since, history).run()


def _seconds(text: str | None) -> float | None:
    """A time from the query; not a number: NaN."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return math.nan


def _count(text: str | None) -> int | None:
    return int(text) if text is not None and text.isascii() and text.isdecimal() and len(text) < 10 else None
