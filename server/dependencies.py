"""What routes ask for: the services of this application, and the experiment that a path names."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Depends, Path, Request, WebSocket
from starlette.requests import HTTPConnection

from server.experiments import Experiment
from server.problems import Refused, at
from server.registry import ExperimentRegistry
from server.scenes import Scenes
from server.settings import Settings


async def kept_for(request: Request, experiment: Experiment) -> None:
    """An experiment was made for a request: if its client has hung up meanwhile, nobody knows it, and it goes again.

    Raises:
        Refused: the client has gone.
    """
    if await request.is_disconnected():
        await _registry(request).delete(experiment.id)
        raise Refused(409, "the client hung up while the experiment was made; it was deleted again")


ExperimentId = Annotated[str, Path(description="an experiment", examples=["3f2a9c01"])]


def _settings(request: Request) -> Settings:
    settings: Settings = request.app.state.settings
    return settings


def _registry(request: Request) -> ExperimentRegistry:
    registry: ExperimentRegistry = request.app.state.registry
    return registry


def _scenes(request: Request) -> Scenes:
    scenes: Scenes = request.app.state.scenes
    return scenes


def _experiment(id: ExperimentId, request: Request) -> Experiment:
    return _registry(request).get(id)


def _experiment_of_socket(id: str, socket: WebSocket) -> Experiment | None:
    registry: ExperimentRegistry = socket.app.state.registry
    try:
        return registry.get(id)
    except Refused:
        return None


def known_query(connection: HTTPConnection) -> None:
    """Refuse query parameters that the OpenAPI document does not give the route.

    Raises:
        Refused: 422, naming the known ones.
    """
    if connection.scope["type"] != "http" or not connection.query_params:
        return
    known = _parameters(connection.app.openapi(), connection.scope["route"].operation_id)
    unknown = [name for name in connection.query_params if name not in known]
    if unknown:
        takes = f"it takes {', '.join(known)}" if known else "it takes none"
        errors = [at([name], f"there is no query parameter {name!r}; {takes}", known, "query") for name in unknown]
        raise Refused(422, errors[0].detail, errors)


def _parameters(document: dict[str, Any], operation_id: str) -> list[str]:
    """Names of the query parameters of an operation of the OpenAPI document."""
    for operation in (operation for methods in document["paths"].values() for operation in methods.values()):
        if operation["operationId"] == operation_id:
            return [parameter["name"] for parameter in operation.get("parameters", ()) if parameter["in"] == "query"]
    return []


SettingsOf = Annotated[Settings, Depends(_settings)]
Registry = Annotated[ExperimentRegistry, Depends(_registry)]
SceneServers = Annotated[Scenes, Depends(_scenes)]
Live = Annotated[Experiment, Depends(_experiment)]
"""The experiment in the path; a problem 404 if there is none."""
LiveSocket = Annotated[Experiment | None, Depends(_experiment_of_socket)]
"""The same for WebSockets, which say so in their own way."""
