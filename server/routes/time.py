"""An experiment's time: clock, advance, rewind."""

from __future__ import annotations

import math

from fastapi import APIRouter, Request

from ftcore import commands
from server.advances import for_as_long_as_the_client_listens
from server.commands import Clock
from server.dependencies import Live, SettingsOf
from server.models import Advance, Advanced, ClockChange, EventState, ExperimentState, Rewind
from server.problems import documented

router = APIRouter(prefix="/experiments/{id}", tags=["time"])
ERRORS = documented(400, 404, 409, 410, 413, 415, 422)


@router.patch("/clock", operation_id="setClock", summary="Run, pause, or change the speed", responses=ERRORS)
async def set_clock(body: ClockChange, experiment: Live) -> ExperimentState:
    """A running experiment keeps pace with the wall clock, ``speed`` seconds of flight a second.

    ``paused`` also stops an advance, after the epoch that is under way; ``running`` is refused while one flies.
    """
    given = {name: getattr(body, name) for name in body.model_fields_set}
    return (await experiment.do(Clock(time=experiment.now, **given))).state


@router.post(
    "/advance",
    operation_id="advanceExperiment",
    summary="Fly on, as fast as it goes",
    responses=ERRORS | documented(503),
)
async def advance_experiment(body: Advance, experiment: Live, settings: SettingsOf, request: Request) -> Advanced:
    """Answers when it is there: the state, what happened on the way, and the last value of every signal.

    Never flies past the end. The result is the same to the bit as with any other way of getting there. Meanwhile the
    clock says `advancing`; faults, switches and settings take effect between two epochs. A client that hangs up stops
    its advance, and so do a paused clock and a rewind (both: 409, which says where), a deletion (410), and the end of
    the server (503). A second advance is refused (409) while one flies.
    """
    command = commands.Advance(time=experiment.now, until=body.until, epochs=body.epochs)
    async with for_as_long_as_the_client_listens(request, settings.max_advance_epochs) as job:
        done = await experiment.do(command, job)
    events = [EventState.model_validate(event, from_attributes=True) for event in done.events]
    return Advanced(experiment=done.state, events=events, latest=numbers(done.latest))


@router.post("/rewind", operation_id="rewindExperiment", summary="Go back", responses=ERRORS)
async def rewind_experiment(body: Rewind, experiment: Live) -> ExperimentState:
    """To an earlier moment, as it was when the clock left it. What came later is forgotten; the clock stops.

    An advance that flies meanwhile ends.
    """
    return (await experiment.do(commands.Rewind(time=experiment.now, to=body.to))).state


def numbers(values: dict[str, float]) -> dict[str, float | None]:
    """Values with None for those that are not numbers."""
    return {name: value if math.isfinite(value) else None for name, value in values.items()}
