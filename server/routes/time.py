"""An experiment's time: clock, advance, rewind."""

from __future__ import annotations

import math

from fastapi import APIRouter, Request

from ftcore import CommandError, Simulation
from server.advances import for_as_long_as_the_client_listens
from server.dependencies import Live, SettingsOf
from server.models import Advance, Advanced, ClockChange, EventState, ExperimentState, Rewind
from server.problems import Refused, at, documented

router = APIRouter(prefix="/experiments/{id}", tags=["time"])
ERRORS = documented(400, 404, 409, 410, 413, 415, 422)


@router.patch("/clock", operation_id="setClock", summary="Run, pause, or change the speed", responses=ERRORS)
async def set_clock(body: ClockChange, experiment: Live) -> ExperimentState:
    """A running experiment keeps pace with the wall clock, ``speed`` seconds of flight a second.

    ``paused`` also stops an advance, after the epoch that is under way; ``running`` is refused while one flies.
    """
    given = body.model_fields_set
    experiment.set_clock(body.state if "state" in given else None, body.speed if "speed" in given else None)
    return await experiment.state()


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
    first_event = 0

    def goal(simulation: Simulation) -> int:
        nonlocal first_event
        first_event = len(simulation.events)
        epoch = _goal(body, simulation)
        if epoch - simulation.epoch > settings.max_advance_epochs:
            field = "epochs" if body.epochs is not None else "until"
            most = f"one advance flies at most {settings.max_advance_epochs} epochs; ask again for the rest"
            raise Refused(409, most, [at([field], most)])
        return epoch

    def outcome(simulation: Simulation) -> Advanced:
        events = [EventState.model_validate(e, from_attributes=True) for e in simulation.events[first_event:]]
        return Advanced(experiment=experiment.describe(simulation), events=events, latest=numbers(simulation.latest()))

    async with for_as_long_as_the_client_listens(request) as advance:
        return await experiment.advance(advance, goal, outcome)


@router.post("/rewind", operation_id="rewindExperiment", summary="Go back", responses=ERRORS)
async def rewind_experiment(body: Rewind, experiment: Live) -> ExperimentState:
    """To an earlier moment, as it was when the clock left it. What came later is forgotten; the clock stops.

    An advance that flies meanwhile ends.
    """
    await experiment.rewind(body.to)
    return await experiment.state()


def _goal(body: Advance, simulation: Simulation) -> int:
    """Epoch that an advance asks for."""
    if body.epochs is not None:
        return min(simulation.last_epoch, simulation.epoch + body.epochs)
    if body.until is None:
        return simulation.last_epoch
    if body.until < simulation.now - 1e-9:
        raise CommandError(
            "until", f"until is {body.until:g} s, but the flight is at {simulation.now:g} s; rewind first"
        )
    return min(simulation.last_epoch, math.floor(body.until / simulation.period + 1e-6))


def numbers(values: dict[str, float]) -> dict[str, float | None]:
    """Values with None for those that are not numbers."""
    return {name: value if math.isfinite(value) else None for name, value in values.items()}
