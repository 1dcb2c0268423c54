"""The ``ftlab`` command: it flies, it serves, and what a person got wrong is one line and exit code 2."""

from __future__ import annotations

import contextlib
import json
import os
import re
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

from ftcore import Scenario, Simulation
from server.cli import main
from server.settings import REPOSITORY
from tests.synthetic_log import ANTENNA, files

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
    path.write_text(Scenario.load("zhang-1992").model_copy(update={"duration": 5.0, "faults": ()}).model_dump_json())
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
        (["serve"], {"FTLAB_FRONTEND": "/no/such/folder"}, "frontend: a folder with the page's index.html"),
        (["serve"], {"FTLAB_MAX_OBSERVATION_BYTES": "999999999"}, "max_observation_bytes"),
        (["serve", "--host", "no.such.host.invalid"], {"FTLAB_TOKEN": "x"}, "cannot be bound"),
        (["run"], {}, "scenario"),
        (["run", "atlantis"], {}, "zhang-1992"),
        (["run", "zhang-1992", "--runs", "0"], {}, "--runs"),
        (["run", "zhang-1992", "--runs", "many"], {}, "--runs"),
        (["run", "zhang-1992", "--signals", "fused.eror"], {}, "no signal 'fused.eror'; for instance fused."),
        (["run", "zhang-1992", "--seed", "-1"], {}, "seed"),
        (["run", "zhang-1992", "--out", "x.xlsx"], {}, ".parquet"),
        (["run", "zhang-1992", "--out", "/no/such/folder/x.csv"], {}, "folder"),
        (["run", "pyproject.toml"], {}, "not a scenario"),
        (["run", "zhang-1992", "--seed", "99999999999999999999"], {}, "seed"),
        (["run", "zhang-1992", "--out", "server"], {}, ".parquet"),
        (["run", "zhang-1992", "--fault", "bias"], {}, "is not JSON; for instance"),
        (["run", "zhang-1992", "--fault", '{"channel": "x"}'], {}, "kind"),
        (["run", "zhang-1992", "--fault", '{"id": "..", "channel": "x", "kind": "bias"}'], {}, "1 to 60 letters"),
        (["run", "zhang-1992", "--fault", '{"channel": "x", "kind": "bias", "magnitude": 1}'], {}, "no channel 'x'"),
        (["run"], {}, "--observation"),
        (["run", "--observation", "a.05o"], {}, "--navigation is missing"),
        (["run", "--navigation", "a.05n"], {}, "--observation is missing"),
        (["run", "zhang-1992", "--antenna", "1,2,3"], {}, "belongs to a log"),
        (["run", "zhang-1992", "--noise-floor", "5"], {}, "belongs to a log"),
        (
            ["run", "--observation", "a", "--navigation", "b", "--noise-floor", "0"],
            {},
            "--noise-floor: a noise floor of 0",
        ),
        (["run", "--observation", "a", "--navigation", "b", "--noise-floor", "x"], {}, "--noise-floor"),
        (["run", "--observation", "a.05o", "--navigation", "a.05n"], {}, "there is no observation file 'a.05o'"),
        (["run", "--observation", "a", "--navigation", "b", "--antenna", "1,2"], {}, "three numbers"),
        (["run", "--observation", "a", "--navigation", "b", "--antenna", "nan,0,0"], {}, "three numbers"),
        (["run", "--observation", "README.md", "--navigation", "LICENSE"], {}, "not a RINEX file"),
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


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[" * 100_000, "not a scenario"),
        ("", "not a scenario"),
        ("[]", "an object with named fields is needed"),
        ('{"system": "gps-receiver", "duration": NaN}', "duration"),
        ('{"system": "gps-receiver", "faults": [{"channel": "x", "kind": "bias"}]}', "no channel 'x'"),
        (
            '{"system": "gps-receiver", "parameters": {"log": {"observation": "a", "navigation": "b"}}}',
            "no observation",
        ),
        (
            '{"system": "gps-receiver", "commands": [{"action": "clear", "time": 3, "fault": "f9"}]}',
            "the scenario's command at 3 s is refused",
        ),
    ],
)
def test_a_document_that_cannot_be_flown_is_one_line(ftlab: Command, tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "wrong.json"
    path.write_text(text)
    status, _, err = ftlab("run", str(path))
    assert (status, len(err.splitlines())) == (2, 1)
    assert says in err


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Options for a log of 20 epochs of 30 s."""
    folder, made = tmp_path_factory.mktemp("log"), files(20)
    (folder / "roof.26o").write_bytes(made.observation)
    (folder / "roof.26n").write_bytes(made.navigation)
    return ["--observation", str(folder / "roof.26o"), "--navigation", str(folder / "roof.26n")]


def test_a_receivers_log_is_flown_and_broken(ftlab: Command, log: list[str], tmp_path: Path) -> None:
    out = tmp_path / "log.parquet"
    fault = {"channel": "gps.pseudorange.G10", "kind": "bias", "magnitude": 100, "start": 120}
    antenna = ",".join(f"{part:.3f}" for part in ANTENNA)
    assert antenna.startswith("-")
    status, told, _ = ftlab("run", *log, "--antenna", antenna, "--fault", json.dumps(fault), "--out", str(out))
    assert status == 0
    assert "Receiver log of 2026-03-04 10:00:00: 600 s" in told
    assert "gps.G10" in told.replace("gps.pseudorange.G10", "")
    table = pq.read_table(out, columns=["time", "combined.error.position.up"])
    assert table["time"].to_pylist() == [30.0 * k for k in range(1, 21)]
    assert max(map(abs, table["combined.error.position.up"].to_pylist())) < 10.0


def test_a_scenario_over_a_log_brings_its_faults_and_settings(ftlab: Command, log: list[str], tmp_path: Path) -> None:
    path = tmp_path / "faults.json"
    fault = {"channel": "gps.pseudorange.G10", "kind": "ramp", "magnitude": 1.0, "start": 120.0}
    document = {"system": "gps-receiver", "faults": [fault], "settings": {"combination": "or"}}
    path.write_text(json.dumps(document | {"parameters": {"mask": 10.0}}))
    status, told, _ = ftlab("run", str(path), *log, "--out", str(tmp_path / "out.html"))
    assert status == 0
    assert "gps.pseudorange.G10" in told
    page = (tmp_path / "out.html").read_text()
    assert '"mask":10.0' in page
    assert '"combination":"or"' in page
    status, _, err = ftlab("run", "zhang-1992", *log)
    assert (status, len(err.splitlines())) == (2, 1)
    assert "flown by the system gps-receiver" in err


def test_a_flight_from_the_command_line_writes_what_it_flew(ftlab: Command, short: str, tmp_path: Path) -> None:
    status, out, _ = ftlab("run", short, "--runs", "3", "--seed", "4", "--out", str(tmp_path / "out.parquet"))
    assert status == 0
    assert "position rms" in out
    assert pq.read_table(tmp_path / "out.parquet").num_rows == 3 * 5
    assert ftlab("run", short, "--out", str(tmp_path / "out.csv"))[0] == 0
    assert (tmp_path / "out.csv").read_text().startswith('"time","run"')
    assert ftlab("run", short, "--out", str(tmp_path / "out.html"))[0] == 0
    assert "Plotly" in (tmp_path / "out.html").read_text()


def test_given_chosen_signals_then_only_they_are_written_and_drawn_and_the_score_is_the_same(
    ftlab: Command, short: str, tmp_path: Path
) -> None:
    chosen = ["--signals", "fused.error.position.up", "--signals", "fused.sigma.position.*"]
    status, told, _ = ftlab("run", short, *chosen, "--out", str(tmp_path / "out.parquet"))
    assert status == 0
    assert told.splitlines()[:-1] == ftlab("run", short)[1].splitlines()
    columns = pq.read_table(tmp_path / "out.parquet").column_names
    assert {name.rpartition(".")[0] for name in columns[2:]} == {"fused.error.position", "fused.sigma.position"}
    assert ftlab("run", short, *chosen, "--out", str(tmp_path / "out.html"))[0] == 0
    page = (tmp_path / "out.html").read_text()
    facts = json.loads(re.findall(r'id="data"[^>]*>(.*?)</script>', page, re.DOTALL)[0])
    drawn = {trace["signal"] for chart in facts["charts"] for trace in chart["traces"]}
    assert drawn == {"fused.error.position.up"}


@pytest.mark.parametrize("suffix", ["parquet", "csv", "html"])
def test_a_file_that_was_there_stays_until_the_new_one_is_whole(
    ftlab: Command, short: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    out = tmp_path / f"out.{suffix}"
    out.write_text("old")
    seen = []

    def breaks(simulation: Simulation) -> Simulation:
        seen.append(out.read_text())
        raise KeyboardInterrupt

    with monkeypatch.context() as broken:
        broken.setattr(Simulation, "step", breaks)
        assert ftlab("run", short, "--out", str(out))[0] == 130
    assert (seen, out.read_text()) == (["old"], "old")
    assert ftlab("run", short, "--out", str(out))[0] == 0
    assert out.stat().st_size > 1000
    assert sorted(os.listdir(tmp_path)) == sorted([out.name, "short.json"])


def test_where_nothing_can_be_written_nothing_is_flown(ftlab: Command, short: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    for out in (tmp_path / "pipe.csv", Path("/proc/out.csv")):
        status, told, err = ftlab("run", short, "--out", str(out))
        assert (status, told, len(err.splitlines())) == (2, "", 1)
        assert f"--out {out} cannot be written" in err


def test_a_title_that_reads_like_markup_is_shown_as_it_is(ftlab: Command, tmp_path: Path) -> None:
    path = tmp_path / "marked.json"
    document = Scenario.load("zhang-1992").model_dump(mode="json") | {
        "duration": 2.0,
        "faults": [],
        "title": "[/bold] [red]A",
    }
    path.write_text(json.dumps(document))
    status, told, _ = ftlab("run", str(path))
    assert status == 0
    assert "[/bold] [red]A: 2 s, seed" in told


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
        for _ in range(1200):
            with contextlib.suppress(httpx.HTTPError):
                assert httpx.get(f"http://127.0.0.1:{port}/api/v1/health").json()["status"] == "ok"
                break
            time.sleep(0.1)
        status, _, taken = ftlab("serve", "--port", str(port))
        assert (status, len(taken.splitlines())) == (2, 1)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
    assert f"http://127.0.0.1:{port}/" in out
    assert "Traceback" not in err


def test_given_a_batch_then_every_rate_is_told_with_denominator_and_interval(ftlab: Command, tmp_path: Path) -> None:
    path = tmp_path / "step.json"
    path.write_text(Scenario.load("chey-2004-step").model_copy(update={"duration": 60.0}).model_dump_json())
    code, out, err = ftlab("run", str(path), "--runs", "3")
    told = " ".join(out.split())
    assert (code, err) == (0, "")
    assert "3 of 3 runs in which it acted (95 %: 29.2 to 100 %)" in told
    assert "False isolations" in told
    assert "sensor-hours of use (95 %: at most" in told
    assert "tests taken as independent" in told
