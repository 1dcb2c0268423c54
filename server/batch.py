"""A scenario flown from the command line: progress, score, file."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from pydantic import ValidationError
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from ftcore import Scenario, Simulation
from ftcore.score import Score
from server import problems, report
from server.settings import UserError

WRITERS: dict[str, Callable[[Simulation, Path], object]] = {
    ".parquet": lambda simulation, path: simulation.to_parquet(path),
    ".csv": lambda simulation, path: simulation.to_csv(path),
    ".html": lambda simulation, path: path.write_bytes(
        report.render(report.gather(simulation, simulation.scenario.title))
    ),
}


def fly(scenario: str, runs: int, seed: int | None, out: Path | None) -> None:
    """Fly, show the score, write the file.

    Raises:
        UserError: something in the request is wrong; nothing was flown.
    """
    write = None if out is None else _writer(out)
    simulation = _simulation(scenario, runs, seed)
    console = Console()
    _advance(simulation, console)
    _show(simulation.score(), simulation, console)
    if out is not None and write is not None:
        write(simulation, out)
        console.print(f"written: {out}")


def _simulation(id_or_path: str, runs: int, seed: int | None) -> Simulation:
    if runs < 1:
        raise UserError(f"--runs is {runs}; at least 1 is needed")
    try:
        scenario = Scenario.load(id_or_path)
    except FileNotFoundError as error:
        raise UserError(str(error)) from None
    except ValidationError as error:
        given = json.loads(Path(id_or_path).read_text("utf-8"))
        raise UserError(f"{id_or_path}: {problems.from_validation(error, given, Scenario).detail}") from None
    except (OSError, ValueError) as error:
        raise UserError(f"{id_or_path} is not a scenario: {error}") from None
    try:
        return Simulation(scenario, runs=runs, seed=seed)
    except ValueError as error:
        raise UserError(str(error)) from None


def _writer(out: Path) -> Callable[[Simulation, Path], object]:
    if out.suffix not in WRITERS:
        raise UserError(f"--out {out}: end it with {', '.join(WRITERS)}")
    if not out.parent.is_dir():
        raise UserError(f"--out {out}: there is no folder {out.parent}")
    try:
        out.open("ab").close()
    except OSError as error:
        raise UserError(f"--out {out}: {error.strerror}") from None
    return WRITERS[out.suffix]


def _advance(simulation: Simulation, console: Console) -> None:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} s"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(simulation.scenario.title, total=simulation.last_epoch * simulation.period)
        while not simulation.finished:
            simulation.step()
            progress.update(task, completed=simulation.now)


def _show(score: Score, simulation: Simulation, console: Console) -> None:
    runs = f", {simulation.runs} runs" if simulation.runs > 1 else ""
    console.print(f"{simulation.scenario.title}: {simulation.now:g} s, seed {simulation.seed}{runs}", highlight=False)
    headline = _table("", "", "compared with")
    for item in score.headline:
        against = f"{_number(item.compare, item.unit)} ({item.compare_label})" if item.compare_label else ""
        headline.add_row(item.label, f"{_number(item.value, item.unit)} {item.note}".rstrip(), against)
    faults = _table("fault", "first alarm", "isolated after", "isolated", "wrongly isolated")
    for fault in score.faults:
        delays = [delay for delay in fault.time_to_alarm.values() if delay is not None]
        faults.add_row(
            fault.label,
            _number(min(delays, default=None), "s"),
            _number(fault.time_to_isolate, "s"),
            ", ".join(fault.isolated) or "-",
            ", ".join(fault.wrong_isolations) or "-",
        )
    estimators = _table("estimator", "position rms", "position worst", "velocity rms", "NEES")
    for name, estimator in score.estimators.items():
        estimators.add_row(
            simulation.description.estimators.get(name, name),
            _number(estimator.position.rms, "m"),
            _number(estimator.position.worst, "m"),
            _number(estimator.velocity.rms, "m/s"),
            _number(estimator.nees, f"of {estimator.nees_dof}" if estimator.nees_dof else ""),
        )
    for table in (headline, faults, estimators):
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
