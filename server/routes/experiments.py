"""Experiments: made, listed, forked, deleted."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter, Request, Response

from ftcore import CommandError
from server.advances import for_as_long_as_the_client_listens
from server.bodies import LargeBodies
from server.dependencies import Live, Registry, SceneServers, kept_for
from server.models import ExperimentState, Fork, NewExperiment
from server.problems import Refused, at, documented
from server.registry import scenario_from

router = APIRouter(prefix="/experiments", tags=["experiments"], route_class=LargeBodies)


@router.post(
    "",
    operation_id="createExperiment",
    summary="Fly a scenario",
    status_code=201,
    responses=documented(400, 404, 409, 413, 415, 422, 429),
)
async def create_experiment(
    body: NewExperiment, registry: Registry, request: Request, response: Response
) -> ExperimentState:
    """A new experiment, paused at t = 0."""
    scenario = await asyncio.to_thread(scenario_from, body.scenario)
    try:
        experiment = await registry.create(scenario, body.seed, body.title)
    except CommandError as error:
        place = at(["scenario", *error.field.split(".")], str(error))
        raise Refused(409, str(error), [place]) from None
    experiment.reusable = body.spare
    await kept_for(request, experiment)
    response.headers["location"] = f"/api/v1/experiments/{experiment.id}"
    return await experiment.state()


@router.get("", operation_id="listExperiments", summary="All experiments", responses=documented())
async def list_experiments(registry: Registry) -> list[ExperimentState]:
    """All live experiments, oldest first."""
    return await asyncio.gather(*(experiment.state() for experiment in registry.all()))


@router.get("/{id}", operation_id="getExperiment", summary="One experiment", responses=documented(404))
async def get_experiment(experiment: Live) -> ExperimentState:
    """The experiment as it stands."""
    return await experiment.state()


@router.delete(
    "/{id}",
    operation_id="deleteExperiment",
    summary="Stop and forget an experiment",
    status_code=204,
    responses=documented(404),
)
async def delete_experiment(experiment: Live, registry: Registry, scenes: SceneServers) -> None:
    """Stops its clock, its scene and its streams. What it recorded is gone."""
    await registry.delete(experiment.id)
    await scenes.forget(experiment.id)


@router.post(
    "/{id}/fork",
    operation_id="forkExperiment",
    summary="Branch off",
    status_code=201,
    responses=documented(400, 404, 409, 413, 415, 422, 429),
)
async def fork_experiment(
    body: Fork, experiment: Live, registry: Registry, request: Request, response: Response
) -> ExperimentState:
    """A second experiment that shares the past of this one up to ``at``, and its noise ever after. It is paused."""
    branch = await registry.fork(experiment, body.at, body.title)
    await kept_for(request, branch)
    response.headers["location"] = f"/api/v1/experiments/{branch.id}"
    return await branch.state()


@router.post(
    "/{id}/ghost",
    operation_id="ghostExperiment",
    summary="The same flight without faults",
    status_code=201,
    responses=documented(404, 409, 410, 429, 503),
)
async def ghost_experiment(
    experiment: Live, registry: Registry, request: Request, response: Response
) -> ExperimentState:
    """A twin with the same scenario, seed and commands, but without any fault, flown to the same time. It is paused.

    A client that hangs up meanwhile leaves none behind.
    """
    async with for_as_long_as_the_client_listens(request) as job:
        twin = await registry.fault_free_twin(experiment, job)
    await kept_for(request, twin)
    response.headers["location"] = f"/api/v1/experiments/{twin.id}"
    return await twin.state()
