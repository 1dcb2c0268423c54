"""A scenario flown from the command line: progress, score, file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from ftcore import CommandError, FlightError, Scenario, Simulation, catalogue
from ftcore.files import check_replaceable, replacing
from ftcore.score import Score, of_alarms
from server import problems, report
from server.models import NewFault
from server.settings import UserError

WRITERS: dict[str, Callable[[Simulation, Path], object]] = {
    ".parquet": lambda simulation, path: simulation.to_parquet(path),
    ".csv": lambda simulation, path: simulation.to_csv(path),
    ".html": lambda simulation, path: _report(simulation, path),
}


def fly(
    scenario: Scenario, runs: int, seed: int | None, out: Path | None, signals: Sequence[str] | None = None
) -> None:
    """Fly, show the score, write the file. Only these ``signals`` are recorded and written; None: all.

    Raises:
        UserError: something in the request is wrong.
    """
    if runs < 1:
        raise UserError(f"--runs is {runs}; at least 1 is needed")
    write = None if out is None else _writer(out)
    try:
        if out is not None:
            check_replaceable(out)  # better now than after the flight
        recorded = signals if signals is not None or out is not None else []
        simulation = _simulation(scenario, runs, seed, recorded)
        console = Console()
        try:
            _advance(simulation, console)
        except CommandError as error:
            raise UserError(str(error)) from None
        except FlightError as error:
            raise UserError(f"{error}; up to then it can be flown with a shorter duration") from None
        _show(simulation.score(), simulation, console)
        if out is not None and write is not None:
            write(simulation, out)
            console.print(f"written: {out}", soft_wrap=True, highlight=False, markup=False)
    except MemoryError:
        raise UserError(f"there is not enough memory for {runs} runs; fly fewer at a time, with other seeds") from None
    except OSError as error:
        raise UserError(f"--out {out} cannot be written: {error.strerror or error}") from None


def _report(simulation: Simulation, path: Path) -> None:
    page = report.render(report.gather(simulation, simulation.scenario.title))
    with replacing(path) as unfinished:
        unfinished.write_bytes(page)


def _simulation(scenario: Scenario, runs: int, seed: int | None, signals: Sequence[str] | None) -> Simulation:
    try:
        return Simulation(scenario, runs=runs, seed=seed, signals=signals)
    except ValueError as error:
        raise UserError(str(error)) from None


def log_from(
    observation: str | None, navigation: str | None, antenna: str | None, noise_floor: float | None = None
) -> dict[str, Any] | None:
    """Scenario document of a receiver's log; None if there is none. Raises UserError."""
    if observation is None and navigation is None:
        if antenna is not None:
            raise UserError("--antenna belongs to a log: give --observation and --navigation too")
        if noise_floor is not None:
            raise UserError("--noise-floor belongs to a log: give --observation and --navigation too")
        return None
    if observation is None or navigation is None:
        missing = "--observation" if observation is None else "--navigation"
        raise UserError(f"a log is two files: {missing} is missing")
    try:
        place = None if antenna is None else _position(antenna)
        return catalogue.log_scenario(observation, navigation, place, noise_floor=noise_floor)
    except ValueError as error:
        option = "--noise-floor: " if getattr(error, "part", None) == "floor" else ""
        raise UserError(f"{option}{error}") from None


def document(scenario: str | None, log: dict[str, Any] | None, faults: Sequence[str]) -> Scenario:
    """The scenario to fly: a ready one or a file, over a log if there is one, with further faults.

    Raises:
        UserError: there is none, or it is wrong; one sentence says where.
    """
    if scenario is None and log is None:
        raise UserError(
            "give a scenario (ftlab scenarios lists the ready ones), or a log by --observation and --navigation"
        )
    given = {} if scenario is None else _load(scenario).model_dump(mode="json", exclude_defaults=True)
    if log is not None:
        system = given.get("system", log["system"])
        if system != log["system"]:
            raise UserError(f"a receiver's log is flown by the system {log['system']}, not by {system}")
        given = given | log | {"parameters": given.get("parameters", {}) | log["parameters"]}
    given["faults"] = [*given.get("faults", []), *(_fault(text) for text in faults)]
    return _scenario(given, scenario or "the log")


def _load(id_or_path: str) -> Scenario:
    try:
        return Scenario.load(id_or_path)
    except FileNotFoundError as error:
        raise UserError(str(error)) from None
    except ValidationError as error:
        given = json.loads(Path(id_or_path).read_text("utf-8"))
        raise UserError(f"{id_or_path}: {problems.from_validation(error, given, Scenario).detail}") from None
    except OSError as error:
        raise UserError(f"{id_or_path} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise UserError(f"{id_or_path} is not a scenario: {error}") from None


def _scenario(given: dict[str, Any], what: str) -> Scenario:
    try:
        return Scenario.model_validate(given)
    except ValidationError as error:
        raise UserError(f"{what}: {problems.from_validation(error, given, Scenario).detail}") from None


def _fault(text: str) -> dict[str, Any]:
    """A fault as JSON, checked as far as it can be without a system."""
    try:
        given = json.loads(text)
        return NewFault.model_validate_json(text, strict=True).model_dump(mode="json", exclude_unset=True)
    except ValidationError as error:
        raise UserError(f"--fault {text}: {problems.from_validation(error, given, NewFault).detail}") from None
    except (ValueError, RecursionError):
        example = '{"channel": "gps.pseudorange.G11", "kind": "bias", "magnitude": 60, "start": 600}'
        raise UserError(f"--fault {text} is not JSON; for instance {example} is") from None


def _position(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise UserError(f"--antenna {text}: three numbers are needed, x,y,z in metres, Earth-fixed")
    return x, y, z


def _writer(out: Path) -> Callable[[Simulation, Path], object]:
    if out.suffix not in WRITERS:
        raise UserError(f"--out {out}: end it with {', '.join(WRITERS)}")
    if not out.parent.is_dir():
        raise UserError(f"--out {out}: there is no folder {out.parent}")
    if out.is_dir():
        raise UserError(f"--out {out} is a folder; name a file")
    return WRITERS[out.suffix]


def _advance(simulation: Simulation, console: Console) -> None:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} s"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(escape(simulation.scenario.title), total=simulation.last_epoch * simulation.period)
        while not simulation.finished:
            simulation.step()
            progress.update(task, completed=simulation.now)


def _show(score: Score, simulation: Simulation, console: Console) -> None:
    runs = f", {simulation.runs} runs" if simulation.runs > 1 else ""
    title = f"{simulation.scenario.title}: {simulation.now:g} s, seed {simulation.seed}{runs}"
    console.print(title, highlight=False, markup=False)
    headline = _table("", "", "compared with")
    for item in score.headline:
        against = f"{_number(item.compare, item.unit)} ({item.compare_label})" if item.compare_label else ""
        headline.add_row(item.label, f"{_number(item.value, item.unit)} {item.note}".rstrip(), against)
    faults = _table("fault", "what came of it")
    for fault in score.faults:
        faults.add_row(fault.label, fault.words)
    deeds = _table("fault", "first acted at", "epochs", "at the end")
    for name, first, epochs, now in report.deeds(simulation):
        deeds.add_row(name, _number(first, "s"), str(epochs), now)
    sound = _table("of the sound", "alarms and isolations")
    labels = {test.name: test.label for test in simulation.description.tests}
    for name, tests in groupby(score.tests, key=lambda test: test.name):
        counted = [test for test in tests if test.epochs or test.reached_epochs]
        if counted:
            sound.add_row(labels[name], of_alarms(counted))
    for subject in score.isolations:
        if subject.count:
            sound.add_row(subject.label, subject.words)
    estimators = _table("estimator", "position rms", "position worst", "velocity rms", "NEES")
    for name, estimator in score.estimators.items():
        estimators.add_row(
            simulation.description.estimators.get(name, name),
            _number(estimator.position.rms, "m"),
            _number(estimator.position.worst, "m"),
            _number(estimator.velocity.rms, "m/s"),
            _number(estimator.nees, f"of {estimator.nees_dof}" if estimator.nees_dof else ""),
        )
    for event in simulation.events:
        if "text" in event.detail and event.time == 0.0:
            console.print(f"note: {event.detail['text']}", highlight=False, markup=False)
    for table in (headline, faults, deeds, sound, estimators):
        if table.row_count:
            console.print()
            console.print(table)


def _table(*headings: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in headings:
        table.add_column(heading, overflow="fold")
    return table


def _number(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" + (f" {unit}" if unit and unit != "1" else "")
