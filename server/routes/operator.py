"""What the operator does to a flight: faults, switches, settings."""

from __future__ import annotations

import json
from typing import Annotated, Any

from fastapi import APIRouter, Body, Path, Response
from pydantic import ValidationError

from ftcore import CommandError, Fault, Simulation
from ftcore.commands import Change, Clear, Configure, Inject, NoSuchFault, Switch, made, plain
from server.commands import Done
from server.dependencies import Live
from server.experiments import Experiment
from server.models import ExperimentState, FaultChange, FaultState, NewFault, SubsystemSwitch
from server.problems import Refused, documented, from_validation

router = APIRouter(prefix="/experiments/{id}", tags=["operator"])
ERRORS = documented(400, 404, 409, 410, 413, 415, 422)
FaultId = Annotated[str, Path(description="a fault of this experiment", examples=["f1"])]


@router.post("/faults", operation_id="injectFault", summary="Inject a fault", status_code=201, responses=ERRORS)
async def inject_fault(body: NewFault, experiment: Live, response: Response) -> FaultState:
    """Lays a fault over a channel, between two epochs; ``start`` defaults to now. It is announced as an event."""
    fault = Fault.model_validate(body.model_dump(exclude_unset=True))
    state = (await experiment.do(made(Inject, {"time": experiment.now, "fault": fault}))).faults[0]
    response.headers["location"] = f"/api/v1/experiments/{experiment.id}/faults/{state.id}"
    return state


@router.get("/faults", operation_id="listFaults", summary="All faults", responses=documented(404))
async def list_faults(experiment: Live) -> list[FaultState]:
    """All faults: armed, active and ended."""
    return (await experiment.state()).faults


@router.get("/faults/{fault}", operation_id="getFault", summary="One fault", responses=documented(404))
async def get_fault(fault: FaultId, experiment: Live) -> FaultState:
    """One fault."""
    for state in (await experiment.state()).faults:
        if state.id == fault:
            return state
    raise Refused(404, f"no fault {fault!r} in this experiment")


@router.patch("/faults/{fault}", operation_id="changeFault", summary="Change a fault", responses=ERRORS)
async def change_fault(fault: FaultId, body: FaultChange, experiment: Live) -> FaultState:
    """Changes what is given; the rest stays."""
    fields = plain(body.model_dump(exclude_unset=True))
    return (await _to_a_fault(experiment, Change, fault, fields=fields)).faults[0]


@router.delete(
    "/faults/{fault}", operation_id="clearFault", summary="Clear a fault", responses=documented(404, 409, 410)
)
async def clear_fault(fault: FaultId, experiment: Live) -> FaultState:
    """Ends one fault now; the channel is truly restored. An ended fault stays in the list."""
    return (await _to_a_fault(experiment, Clear, fault)).faults[0]


@router.delete("/faults", operation_id="clearFaults", summary="Clear all faults", responses=documented(404, 409, 410))
async def clear_faults(experiment: Live) -> list[FaultState]:
    """Ends every fault that is armed or active; answers those."""
    return list((await experiment.do(Clear(time=experiment.now))).faults)


@router.patch("/subsystems/{name}", operation_id="switchSubsystem", summary="Switch a subsystem", responses=ERRORS)
async def switch_subsystem(name: str, body: SubsystemSwitch, experiment: Live) -> ExperimentState:
    """Switches a subsystem off or on."""
    if name not in (known := [subsystem.name for subsystem in experiment.description.subsystems]):
        raise Refused(404, f"no subsystem {name!r}; there are {', '.join(known)}")
    return (await experiment.do(Switch(time=experiment.now, subsystem=name, enabled=body.enabled))).state


@router.patch("/settings", operation_id="changeSettings", summary="Change settings", responses=ERRORS)
async def change_settings(
    body: Annotated[
        dict[str, Any],
        Body(
            min_length=1,
            description="by the system's settings_schema",
            examples=[{"false_alarm_probability": 0.001}],
        ),
    ],
    experiment: Live,
) -> ExperimentState:
    """Changes settings of the system while it flies, such as the false-alarm probability or the driving test."""

    await experiment.read(lambda simulation: _refuse_unfit(simulation, body))
    return (await experiment.do(made(Configure, {"time": experiment.now, "settings": plain(body)}))).state


def _refuse_unfit(simulation: Simulation, settings: dict[str, Any]) -> None:
    """Raise Refused, naming all that is wrong, if the settings do not fit the form or one another."""
    form = simulation.scenario.model.Settings
    try:
        form.model_validate_json(json.dumps(simulation.settings | settings), strict=True)
    except ValidationError as error:
        raise from_validation(error, settings, form, free=settings) from None


async def _to_a_fault(experiment: Experiment, form: type[Change] | type[Clear], fault: str, **values: Any) -> Done:
    """Do a command to the fault of the path. Raises Refused (404) if there is none of that id."""
    try:
        command = made(form, {"time": experiment.now, "fault": fault, **values})
    except CommandError:
        raise Refused(404, f"no fault {fault!r} in this experiment") from None
    try:
        return await experiment.do(command)
    except NoSuchFault as error:
        raise Refused(404, str(error)) from None
