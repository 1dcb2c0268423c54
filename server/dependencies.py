"""What routes ask for: the services of this application, and the experiment that a path names."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Path, Request, WebSocket

from server.experiments import Experiment
from server.problems import Refused
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


SettingsOf = Annotated[Settings, Depends(_settings)]
Registry = Annotated[ExperimentRegistry, Depends(_registry)]
SceneServers = Annotated[Scenes, Depends(_scenes)]
Live = Annotated[Experiment, Depends(_experiment)]
"""The experiment in the path; a problem 404 if there is none."""
LiveSocket = Annotated[Experiment | None, Depends(_experiment_of_socket)]
"""The same for WebSockets, which say so in their own way."""
