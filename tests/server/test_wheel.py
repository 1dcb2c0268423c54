"""A wheel of the project is the whole laboratory: it serves the page from a place that is no checkout."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import sysconfig
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from server.settings import REPOSITORY


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project as a wheel, built from a copy of what git knows, without a network."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE", "ftcore", "server", "frontend"):
        subprocess.run(["cp", "-r", str(REPOSITORY / name), str(source)], check=True)
    command = ["pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "--no-index", "-w", str(out), str(source)]
    subprocess.run([sys.executable, "-m", *command], check=True, capture_output=True, text=True)
    (built,) = out.glob("ftlab-*.whl")
    return built


@pytest.fixture(scope="module")
def bare(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual environment that has the wheel and, by a path file, the libraries that it depends on: nothing of the
    checkout, for path files inside such a folder are not read."""
    folder = tmp_path_factory.mktemp("bare")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    python = folder / "bin" / "python"
    install = ["pip", "--python", str(python), "install", "-q", "--no-deps", "--no-index", str(wheel)]
    subprocess.run([sys.executable, "-m", *install], check=True, capture_output=True, text=True)
    (site,) = folder.glob("lib/python*/site-packages")
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib"), "utf-8")
    return folder


@pytest.fixture(scope="module")
def base(bare: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of `ftlab serve` of that environment, started somewhere else."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("FTLAB_", "PYTHON", "PORT"))}
    process = subprocess.Popen(
        [str(bare / "bin" / "ftlab"), "serve", "--port", "0"],
        cwd=tmp_path_factory.mktemp("elsewhere"),
        env=environment | {"PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        address = process.stdout.readline().split()[2].rstrip("/")
        for _ in range(1200):
            with contextlib.suppress(httpx.HTTPError):
                httpx.get(f"{address}/api/v1/health")
                break
            time.sleep(0.1)
        yield address
    finally:
        process.terminate()
        process.wait(120)


def test_given_a_bare_environment_with_the_wheel_then_it_serves_the_page_and_all_it_is_made_of(base: str) -> None:
    page = httpx.get(f"{base}/")
    assert page.status_code == 200
    assert "<title>" in page.text
    for path in sorted(REPOSITORY.glob("frontend/**/*.*")):
        if path.suffix in (".js", ".css"):
            answer = httpx.get(f"{base}/static/{path.relative_to(REPOSITORY / 'frontend').as_posix()}")
            assert answer.status_code == 200, path.name
            assert answer.content == path.read_bytes(), path.name


def test_given_a_bare_environment_with_the_wheel_then_a_scenario_flies(base: str) -> None:
    scenarios = httpx.get(f"{base}/api/v1/scenarios").json()
    made = httpx.post(f"{base}/api/v1/experiments", json={"scenario": scenarios[0]["id"]}, timeout=300.0)
    assert made.status_code == 201
    flown = httpx.post(
        f"{base}/api/v1/experiments/{made.json()['id']}/advance", json={"epochs": 2}, timeout=300.0
    ).json()
    assert flown["experiment"]["clock"]["epoch"] == 2


def test_given_the_wheel_then_it_holds_every_module_and_every_data_file_of_the_tree(wheel: Path) -> None:
    inside = set(zipfile.ZipFile(wheel).namelist())
    for room in ("ftcore", "server", "frontend"):
        for path in (REPOSITORY / room).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts and path.suffix not in (".pyc", ".ts"):
                if path.name == "tsconfig.json":
                    continue
                assert path.relative_to(REPOSITORY).as_posix() in inside
