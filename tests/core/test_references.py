"""A paper is called by its author and year, wherever a reader may meet it."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
READ = {".py", ".js", ".ts", ".html", ".css", ".json", ".md", ".toml"}
FILE_NUMBER = re.compile(r"(?<![\w.,:+-])(?<!\d )00\d(?![\w]|[.,:]\d)")
"""Three figures that are no number: not the end of 1 000, of 0.001 or of 2:000, not the start of 001.5."""


def written() -> list[Path]:
    tops = [ROOT / name for name in ("ftcore", "server", "frontend", "tests", "docs")]
    found = [path for top in tops for path in top.rglob("*") if path.suffix in READ]
    return [path for path in (*found, *ROOT.glob("*.md"), *ROOT.glob("*.toml")) if path != Path(__file__)]


def test_no_text_calls_a_paper_by_the_number_of_its_file() -> None:
    texts = [(path.relative_to(ROOT), path.read_text(encoding="utf-8").splitlines()) for path in written()]
    lines = [f"{path}:{i + 1}: {line.strip()}" for path, lines in texts for i, line in enumerate(lines)]
    assert len(lines) > 10_000
    assert [line for line in lines if FILE_NUMBER.search(line.split(": ", 1)[1])] == []


@pytest.mark.parametrize("reference", ["000 (48)", "by 001's gradients", '"002, Table 2"', "(003)", "mechanics of 002"])
def test_a_file_number_would_be_found(reference: str) -> None:
    assert FILE_NUMBER.search(reference)


@pytest.mark.parametrize("number", ["0.001", "10_000", "40 000 runs", "127.0.0.1:8000", "0.0005", "12.000"])
def test_a_number_is_no_file_number(number: str) -> None:
    assert not FILE_NUMBER.search(number)
