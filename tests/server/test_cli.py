"""The ``ftlab`` command: it flies, it serves, and what a person got wrong is one line and exit code 2."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import httpx
import pyarrow.parquet as pq
import pytest

from ftcore import Scenario
from server.cli import main
from server.settings import REPOSITORY

Command = Callable[..., tuple[object, str, str]]
COMMAND = [sys.executable, "-c", "from server.cli import main; main()"]


@pytest.fixture(autouse=True)
def _nothing_set(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in os.environ if name == "PORT" or name.startswith("FTLAB_")]:
        monkeypatch.delenv(name)


@pytest.fixture
def ftlab(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """The command in this process: arguments in, exit status, stdout and stderr out."""

    def run(*arguments: str) -> tuple[object, str, str]:
        monkeypatch.chdir(REPOSITORY)
        monkeypatch.setattr(sys, "argv", ["ftlab", *arguments])
        with pytest.raises(SystemExit) as left:
            main()
        return left.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def short(tmp_path: Path) -> str:
    path = tmp_path / "short.json"
    path.write_text(Scenario.load("zhang-1992").model_copy(update={"duration": 5.0}).model_dump_json())
    return str(path)


@pytest.mark.parametrize(
    ("arguments", "environment", "says"),
    [
        (["bogus"], {}, "bogus"),
        (["serve", "--bogus"], {}, "--bogus"),
        (["serve", "--port", "x"], {}, "--port"),
        (["serve", "--port", "70000"], {}, "port"),
        (["serve", "--host", "0.0.0.0"], {}, "needs a token"),
        (["serve"], {"FTLAB_HOST": "192.168.1.7"}, "needs a token"),
        ([], {"PORT": "seven"}, "port"),
        (["serve"], {"FTLAB_WORKERS": "0"}, "workers"),
        (["serve", "--host", "no.such.host.invalid"], {"FTLAB_TOKEN": "x"}, "cannot be bound"),
        (["run"], {}, "scenario"),
        (["run", "atlantis"], {}, "zhang-1992"),
        (["run", "zhang-1992", "--runs", "0"], {}, "--runs"),
        (["run", "zhang-1992", "--runs", "many"], {}, "--runs"),
        (["run", "zhang-1992", "--seed", "-1"], {}, "seed"),
        (["run", "zhang-1992", "--out", "x.xlsx"], {}, ".parquet"),
        (["run", "zhang-1992", "--out", "/no/such/folder/x.csv"], {}, "folder"),
        (["run", "pyproject.toml"], {}, "not a scenario"),
    ],
)
def test_what_a_person_got_wrong_is_one_line(
    ftlab: Command, monkeypatch: pytest.MonkeyPatch, arguments: list[str], environment: dict[str, str], says: str
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    status, out, err = ftlab(*arguments)
    assert (status, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert err.startswith("ftlab: ")
    assert says in err


def test_a_scenario_that_is_wrong_inside_is_told_where(ftlab: Command, tmp_path: Path) -> None:
    path = tmp_path / "wrong.json"
    path.write_text(json.dumps({"system": "sins-gps-doppler", "duration": -1}))
    status, _, err = ftlab("run", str(path))
    assert status == 2
    assert "duration" in err
    assert len(err.splitlines()) == 1


def test_a_flight_from_the_command_line_writes_what_it_flew(ftlab: Command, short: str, tmp_path: Path) -> None:
    status, out, _ = ftlab("run", short, "--runs", "3", "--seed", "4", "--out", str(tmp_path / "out.parquet"))
    assert status == 0
    assert "position rms" in out
    assert pq.read_table(tmp_path / "out.parquet").num_rows == 3 * 5
    assert ftlab("run", short, "--out", str(tmp_path / "out.csv"))[0] == 0
    assert (tmp_path / "out.csv").read_text().startswith('"time","run"')
    assert ftlab("run", short, "--out", str(tmp_path / "out.html"))[0] == 0
    assert "Plotly" in (tmp_path / "out.html").read_text()


def test_scenarios_and_version_are_listed(ftlab: Command) -> None:
    assert "zhang-1992-visible" in ftlab("scenarios")[1]
    assert ftlab("--version")[1].startswith("ftlab ")


def test_it_serves_until_it_is_stopped(ftlab: Command) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    process = subprocess.Popen(
        COMMAND,
        env=os.environ | {"PORT": str(port)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=REPOSITORY,
    )
    try:
        for _ in range(300):
            with contextlib.suppress(httpx.HTTPError):
                assert httpx.get(f"http://127.0.0.1:{port}/api/v1/health").json()["status"] == "ok"
                break
            time.sleep(0.1)
        status, _, taken = ftlab("serve", "--port", str(port))
        assert (status, len(taken.splitlines())) == (2, 1)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=10)
    finally:
        process.kill()
    assert f"http://127.0.0.1:{port}/" in out
    assert "Traceback" not in err
