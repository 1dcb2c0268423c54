"""What the operator does to a flight: faults, switches, settings."""

from __future__ import annotations

import json
from typing import Annotated, Any

from fastapi import APIRouter, Body, Path, Response
from pydantic import ValidationError

from ftcore import Fault, Simulation
from server.dependencies import Live
from server.faults import fault_state
from server.models import ExperimentState, FaultChange, FaultState, NewFault, SubsystemSwitch
from server.problems import Refused, documented, from_validation

router = APIRouter(prefix="/experiments/{id}", tags=["operator"])
ERRORS = documented(400, 404, 409, 410, 413, 415, 422)
FaultId = Annotated[str, Path(description="a fault of this experiment", examples=["f1"])]


@router.post("/faults", operation_id="injectFault", summary="Inject a fault", status_code=201, responses=ERRORS)
async def inject_fault(body: NewFault, experiment: Live, response: Response) -> FaultState:
    """Lays a fault over a channel, between two epochs; ``start`` defaults to now. It is announced as an event."""
    fault = Fault.model_validate(body.model_dump(exclude_unset=True))
    state = await experiment.command(lambda simulation: fault_state(simulation, simulation.inject(fault)))
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
    fields = body.model_dump(exclude_unset=True)

    def change(simulation: Simulation) -> FaultState:
        _find(simulation, fault)
        return fault_state(simulation, simulation.change(fault, **fields))

    return await experiment.command(change)


@router.delete(
    "/faults/{fault}", operation_id="clearFault", summary="Clear a fault", responses=documented(404, 409, 410)
)
async def clear_fault(fault: FaultId, experiment: Live) -> FaultState:
    """Ends one fault now; the channel is truly restored. An ended fault stays in the list."""

    def clear(simulation: Simulation) -> FaultState:
        _find(simulation, fault)
        return fault_state(simulation, simulation.clear(fault))

    return await experiment.command(clear)


@router.delete("/faults", operation_id="clearFaults", summary="Clear all faults", responses=documented(404, 409, 410))
async def clear_faults(experiment: Live) -> list[FaultState]:
    """Ends every fault that is armed or active; answers those."""
    return await experiment.command(lambda s: [fault_state(s, fault) for fault in s.clear_all()])


@router.patch("/subsystems/{name}", operation_id="switchSubsystem", summary="Switch a subsystem", responses=ERRORS)
async def switch_subsystem(name: str, body: SubsystemSwitch, experiment: Live) -> ExperimentState:
    """Switches a subsystem off or on."""
    if name not in (known := [subsystem.name for subsystem in experiment.description.subsystems]):
        raise Refused(404, f"no subsystem {name!r}; there are {', '.join(known)}")
    await experiment.command(lambda simulation: simulation.switch(name, body.enabled))
    return await experiment.state()


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

    def configure(simulation: Simulation) -> None:
        form = simulation.scenario.model.Settings
        try:
            form.model_validate_json(json.dumps(simulation.settings | body), strict=True)
        except ValidationError as error:
            raise from_validation(error, body, form, free=body) from None
        simulation.configure(**body)

    await experiment.command(configure)
    return await experiment.state()


def _find(simulation: Simulation, id: str) -> None:
    """Raise Refused (404) if there is no such fault."""
    ids = [str(live.fault.id) for live in simulation.faults]
    if id not in ids:
        raise Refused(404, f"no fault {id!r}; there is {', '.join(ids) or 'none'}")
