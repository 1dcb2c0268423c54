"""All experiments: made, found, forked, deleted, and never more than the cap."""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from ftcore import Scenario, Simulation, catalogue
from ftcore.commands import Advance, Change, Clear, Inject
from server import problems
from server.advances import Job
from server.experiments import Experiment
from server.models import whole
from server.pacing import Clock
from server.problems import Refused, at
from server.settings import Settings
from server.turns import Workers
from server.uploads import Uploads


@dataclass(frozen=True)
class ReceiverLog:
    """What was uploaded: contents of the two files, and what was given besides.

    ``antenna``: position [m], Earth-fixed; ``noise_floor`` [m]; None where not given.
    """

    observation: bytes
    navigation: bytes
    antenna: tuple[float, float, float] | None
    noise_floor: float | None = None


class ExperimentRegistry:
    """The experiments of this server, and the uploaded files that they use. Lives on the event loop.

    Args:
        settings: what can be set.
        uploads: the folder of uploaded files.
        clock: what experiments fly by; the machine's if absent.
    """

    def __init__(self, settings: Settings, uploads: Uploads, clock: Clock | None = None) -> None:
        self.settings = settings
        self.uploads = uploads
        self._experiments: dict[str, Experiment] = {}
        self._reserved = 0
        self.leaving = False
        self._reader = asyncio.Semaphore(1)  # reading a large log takes a core and some memory: one at a time
        self._executor = ThreadPoolExecutor(settings.workers, thread_name_prefix="flight")
        self._workers = Workers(self._executor, settings.workers, clock or Clock())

    def __len__(self) -> int:
        """Live experiments."""
        return len(self._experiments)

    def all(self) -> list[Experiment]:
        """All experiments, oldest first."""
        return list(self._experiments.values())

    @property
    def making(self) -> int:
        """Experiments that are being made."""
        return self._reserved

    def get(self, id: str) -> Experiment:
        """One experiment. Raises Refused (404) if there is none of that id."""
        if id not in self._experiments:
            raise Refused(404, f"no experiment {id!r}; GET /api/v1/experiments lists those there are")
        return self._experiments[id]

    async def create(self, scenario: Scenario, seed: int | None = None, title: str | None = None) -> Experiment:
        """A new experiment, paused at t = 0. Raises Refused (429) at the cap."""
        with self._using(scenario):
            return await self._add(lambda: Simulation(scenario, seed=seed, max_epochs=self.settings.max_epochs), title)

    async def create_from_log(self, log: ReceiverLog, title: str | None = None) -> Experiment:
        """An experiment that flies a receiver's log, paused at t = 0.

        Raises:
            LogError, CommandError: the log cannot be used; one sentence.
            Refused: 429 at the cap of experiments or of what may be uploaded.
        """
        files = (log.observation, log.navigation)

        def make() -> Simulation:
            for name, content in zip(names, files, strict=True):
                self.uploads.write(name, content)
            document = catalogue.log_scenario(
                names[0], names[1], log.antenna, self.settings.max_log_epochs, log.noise_floor
            )
            return Simulation(Scenario.model_validate(document), max_epochs=self.settings.max_epochs)

        try:
            with self.uploads.adding(*files) as names:
                async with self._reader:
                    return await self._add(make, title)
        finally:
            self._tidy()

    async def fork(self, parent: Experiment, at: float | None, title: str | None) -> Experiment:
        """A second flight that shares the past of ``parent``. Raises CommandError outside the flight."""
        with self._room(), self._using(parent.scenario):
            branch = await parent.read(lambda simulation: simulation.fork(at))
            return self._enter(branch, title or f"{parent.title} (branch)", parent=parent.id)

    async def fault_free_twin(self, original: Experiment, job: Job) -> Experiment:
        """The same flight without any fault, flown to the same time by ``job``.

        Raises:
            Refused: at the cap, or the flight failed or was stopped; then there is no twin.
        """
        document, epoch = await original.read(lambda simulation: (simulation.document(), simulation.epoch))
        scenario = without_faults(document)
        with self._using(scenario):
            twin = await self._add(
                lambda: Simulation(scenario, max_epochs=self.settings.max_epochs),
                f"{original.title} (without faults)",
                ghost_of=original.id,
            )
        try:
            await twin.do(Advance(time=0.0, epochs=epoch), job)
        except Refused:
            if not twin.closed:
                await self.delete(twin.id)
            raise
        return twin

    async def delete(self, id: str) -> None:
        """Stop and forget an experiment. Raises Refused (404) if there is none of that id."""
        experiment = self.get(id)
        del self._experiments[id]
        await experiment.close()
        self._tidy()

    def leave(self) -> None:
        """The server is about to be stopped: whoever waits for a flight gets an answer while there is time for one."""
        self.leaving = True
        for experiment in self._experiments.values():
            experiment.stop_advance("leaving")

    async def close(self) -> None:
        """Stop everything."""
        await asyncio.gather(*(self.delete(id) for id in list(self._experiments)))
        self._executor.shutdown()

    async def _add(self, make: Callable[[], Simulation], title: str | None, **relation: str) -> Experiment:
        with self._room():
            simulation = await asyncio.to_thread(make)
            return self._enter(simulation, title, **relation)

    def _enter(self, simulation: Simulation, title: str | None, **relation: str) -> Experiment:
        id = secrets.token_hex(4)
        experiment = Experiment(id, simulation, self._workers, title, **relation)
        self._experiments[id] = experiment
        return experiment

    @contextlib.contextmanager
    def _using(self, scenario: Scenario) -> Iterator[None]:
        """Keep the uploaded files of a scenario while an experiment is made of it."""
        try:
            with self.uploads.holding(self.uploads.named_in(scenario)):
                yield
        finally:
            self._tidy()

    def _tidy(self) -> None:
        """Delete uploaded files that no experiment uses any more."""
        if len(self.uploads):
            self.uploads.keep({name for e in self.all() for name in self.uploads.named_in(e.scenario)})

    def _room(self) -> _Reservation:
        cap = self.settings.max_experiments
        if len(self._experiments) + self._reserved >= cap:
            raise Refused(429, f"there are {cap} experiments already, the most this server takes; delete one first")
        return _Reservation(self)

    def reserve(self, places: int) -> None:
        """Keep a place for an experiment that is being made."""
        self._reserved += places


class _Reservation:
    """A place kept while an experiment is being made in a thread."""

    def __init__(self, registry: ExperimentRegistry) -> None:
        self._registry = registry

    def __enter__(self) -> None:
        self._registry.reserve(1)

    def __exit__(self, *_: object) -> None:
        self._registry.reserve(-1)


def scenario_from(given: str | dict[str, Any]) -> Scenario:
    """A ready scenario by id, or a document, strictly read.

    Raises:
        Refused: 404 unknown id, 422 not a scenario, 409 a scenario that contradicts itself.
    """
    if isinstance(given, str):
        try:
            return catalogue.scenario(given)
        except catalogue.CatalogueError as error:
            raise Refused(404, str(error), [at(["scenario"], str(error))]) from None
    if (wide := _too_wide(given)) is not None:
        raise Refused(422, wide, [at(["scenario"], wide)])
    document = given | {"seed": whole(given["seed"])} if "seed" in given else given
    try:
        return Scenario.model_validate_json(json.dumps(document), strict=True)
    except ValidationError as error:
        raise problems.from_validation(error, given, Scenario, ("scenario",), free=("parameters", "settings")) from None


MOST_FIELDS = 1000
"""Most fields of an object, and items of a list but that of the commands, in a scenario. No form has as many, and each
wrong one would be told by name."""


def _too_wide(document: dict[str, Any]) -> str | None:
    """What is wrong with a document that has more fields or items somewhere than any form; None if it has not."""
    waiting: list[Any] = [document]
    while waiting:
        value = waiting.pop()
        inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        if len(inner) > MOST_FIELDS and value is not document.get("commands"):
            return f"{len(inner)} fields or items in one place are not a scenario's; at most {MOST_FIELDS} are read"
        waiting += inner
    return None


def without_faults(scenario: Scenario) -> Scenario:
    """The scenario with everything the operator did, except faults."""
    kept = tuple(command for command in scenario.commands if not isinstance(command, Inject | Change | Clear))
    return scenario.model_copy(update={"faults": (), "commands": kept})
