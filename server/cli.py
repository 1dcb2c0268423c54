"""The ``ftlab`` command."""

from __future__ import annotations

import os
import socket
import sys
import threading
import webbrowser
from importlib import metadata
from pathlib import Path
from typing import Annotated

import typer

from server.settings import Settings, UserError

application = typer.Typer(
    help="FTLab: fly, break a sensor, see which test notices and what it costs in metres.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"ftlab {metadata.version('ftlab')}")
        raise typer.Exit


@application.callback(invoke_without_command=True)
def _ftlab(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """Without a command: serve."""
    if context.invoked_subcommand is None:
        serve()


@application.command()
def serve(
    host: Annotated[str | None, typer.Option(help="Address to bind; another than 127.0.0.1 needs FTLAB_TOKEN.")] = None,
    port: Annotated[int | None, typer.Option(help="Port to bind; PORT in the environment says so too.")] = None,
    open: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> None:
    """Serve the page and the API on this machine."""
    from server.app import create_app
    from server.serving import server_of

    settings = Settings.from_environment(host=host, port=port)
    with _bound(settings) as listening:
        port = listening.getsockname()[1]
        address = f"http://{f'[{settings.host}]' if ':' in settings.host else settings.host}:{port}/"
        typer.echo(f"FTLab at {address}  (stop with Ctrl-C)")
        if open:
            threading.Timer(1.0, webbrowser.open, [address]).start()
        server_of(create_app(settings)).run(sockets=[listening])


def _bound(settings: Settings) -> socket.socket:
    """A socket on the address asked for. Raises UserError if it cannot be had."""
    listening = socket.socket(socket.AF_INET6 if ":" in settings.host else socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((settings.host, settings.port))
    except OSError as error:
        listening.close()
        reason = error.strerror or str(error)
        raise UserError(f"{settings.host}:{settings.port} cannot be bound: {reason}; try --port") from None
    return listening


@application.command()
def scenarios() -> None:
    """List the ready scenarios."""
    from rich.console import Console
    from rich.table import Table

    from ftcore import catalogue

    table = Table(box=None, pad_edge=False)
    for heading in ("scenario", "system", "what happens"):
        table.add_column(heading, overflow="fold")
    for scenario in catalogue.scenarios():
        table.add_row(scenario.id, scenario.system, scenario.title)
    Console().print(table)


@application.command()
def run(
    scenario: Annotated[str | None, typer.Argument(help="Id of a ready scenario, or a JSON file.")] = None,
    observation: Annotated[str | None, typer.Option(help="A receiver's log: RINEX observation file.")] = None,
    navigation: Annotated[str | None, typer.Option(help="Its navigation file, of the same day.")] = None,
    antenna: Annotated[str | None, typer.Option(help="True position of its antenna: x,y,z, Earth-fixed, m.")] = None,
    noise_floor: Annotated[
        float | None, typer.Option(help="Pseudorange 1-sigma to assume of the log at every elevation, m.")
    ] = None,
    fault: Annotated[
        list[str] | None, typer.Option(help="A fault as JSON, as over REST; may be given several times.")
    ] = None,
    runs: Annotated[int, typer.Option(help="How many runs, side by side.")] = 1,
    seed: Annotated[int | None, typer.Option(help="Instead of the scenario's.")] = None,
    out: Annotated[Path | None, typer.Option(help="Where to write: .parquet, .csv or .html.")] = None,
    signals: Annotated[
        list[str] | None,
        typer.Option(help="Record this signal only, or those of a pattern ('test.*'); may be given several times."),
    ] = None,
) -> None:
    """Fly a scenario, or a receiver's log of your own, to its end and score it.

    A log with a scenario flies with the scenario's faults, settings and parameters.
    """
    from server import batch

    batch.fly(
        batch.document(scenario, batch.log_from(observation, navigation, antenna, noise_floor), fault or []),
        runs,
        seed,
        out,
        signals or None,
    )


def main() -> None:
    """Entry point: whatever a person can put right ends in one line on stderr and exit code 2."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # flights share the cores among themselves
    try:
        status = application(standalone_mode=False)
        sys.exit(status if isinstance(status, int) else 0)
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(130)
    except typer.TyperException as error:
        describe = getattr(error, "format_message", error.__str__)
        _leave(f"{describe().rstrip('. ')}; see ftlab --help")
    except UserError as error:
        _leave(str(error))


def _leave(message: str) -> None:
    sys.stderr.write(f"ftlab: {' '.join(message.split())}\n")
    sys.exit(2)
