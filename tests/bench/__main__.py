"""`python -m tests.bench`: the table of what FTLab costs, targets beside the figures, each met or missed.

A missed figure fails nothing. `--json` for a machine.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import asdict
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from threadpoolctl import threadpool_limits

from ftcore import catalogue
from tests.bench import covariance, flights, inertial, integrated, page, parts, pieces, server
from tests.bench.measure import REFERENCE_CALL, REFERENCE_RATE, Figure, call_and_rate, pace


def measured(console: Console) -> tuple[list[Figure], dict[str, dict[str, tuple[float, float]]]]:
    """All figures, and for every system the cost of an epoch by part."""
    found: list[Figure] = []
    by_part = {}
    paces = []
    with Progress(console=console, transient=True) as progress, threadpool_limits(1):
        task = progress.add_task("measuring", total=7 + len(catalogue.systems()))
        for take in (
            lambda: flights.figures(2),
            lambda: covariance.figures(9),
            lambda: inertial.figures(5),
            lambda: integrated.figures(3),
            lambda: pieces.figures(3),
            server.figures,
            page.figures,
        ):
            paces.append(pace(0.5))
            found += take()
            progress.advance(task)
        found.insert(0, pace_line(paces, *call_and_rate()))
        for system in catalogue.systems():
            by_part[system.id] = parts.both(flights.default_scenario(system.id))
            progress.advance(task)
    return found, by_part


def pace_line(paces: list[float], call: float, rate: float) -> Figure:
    """How this machine compares with the one that the targets in seconds are for, while the table was measured."""
    return Figure(
        "this machine",
        "pace: how many times slower than the reference machine",
        sum(paces) / len(paces),
        "x",
        note=f"{min(paces):.2f} to {max(paces):.2f} meanwhile; at best {1e6 * call:.1f} us a product of two 21 x 21 "
        f"matrices, {1e-9 * rate:.0f} GFlop/s in a batch; there {1e6 * REFERENCE_CALL:.1f} us, "
        f"{1e-9 * REFERENCE_RATE:.0f} GFlop/s",
    )


def figure_table(found: list[Figure]) -> Table:
    """Targets beside figures, and figures that hang on the machine at the reference machine's pace as well."""
    table = Table(title="FTLab, processor time of one core, one BLAS thread")
    for heading, style in (("of", "dim"), ("figure", "")):
        table.add_column(heading, style=style)
    for heading, style in (("measured", "bold"), ("at reference pace", "bold"), ("target", "")):
        table.add_column(heading, style=style, justify="right")
    for style in ("", "dim"):
        table.add_column("", style=style)
    for i, f in enumerate(found):
        repeated = i > 0 and found[i - 1].subject == f.subject
        goal = "" if f.target is None else f"{'>=' if f.sense == 'least' else '<='} {f.target:g} {f.unit}"
        verdict = {None: "", True: "[green]met[/]", False: "[red]missed[/]"}[f.met]
        there = "" if f.at_reference is None else f"{f.at_reference:.3g} {f.unit}"
        table.add_row("" if repeated else f.subject, f.name, f"{f.value:.3g} {f.unit}", there, goal, verdict, f.note)
    return table


def part_table(system: str, costs: dict[str, tuple[float, float]]) -> Table:
    """Milliseconds and shares by part."""
    table = Table(title=f"{system}: one epoch by part, sampled")
    table.add_column("part")
    for heading in ("1 run, ms", "share", f"{flights.BATCH} runs, ms", "share"):
        table.add_column(heading, justify="right")
    one, many = (sum(c[i] for c in costs.values()) for i in (0, 1))
    for name, (a, b) in costs.items():
        table.add_row(name, f"{a:.2f}", f"{100 * a / one:.0f} %", f"{b:.1f}", f"{100 * b / many:.0f} %")
    table.add_section()
    table.add_row("all", f"{one:.2f}", "", f"{many:.1f}", "")
    return table


def as_json(found: list[Figure], by_part: dict[str, dict[str, tuple[float, float]]]) -> dict[str, Any]:
    """The same for a machine; times in milliseconds."""
    costs = {
        system: {part: {"one": a, "batch": b} for part, (a, b) in parts_of.items()}
        for system, parts_of in by_part.items()
    }
    return {"figures": [asdict(f) | {"met": f.met} for f in found], "epoch_by_part": costs}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    as_wanted = parser.parse_args()
    found, by_part = measured(Console(stderr=True))
    if as_wanted.json:
        print(json.dumps(as_json(found, by_part), indent=2))
        return
    console = Console()
    console.print(figure_table(found))
    for system, costs in by_part.items():
        console.print(part_table(system, costs))


if __name__ == "__main__":
    main()
