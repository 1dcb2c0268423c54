"""Ids and titles: what a document may call things, so that no path, header, report or terminal is bent by it."""

from __future__ import annotations

import json
import re
from typing import Any
from urllib.parse import urljoin, urlsplit

import httpx
import pytest
import toy_system as toy
from fastapi.testclient import TestClient
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from rest_lab import API, Flight

from ftcore import Fault, Scenario, catalogue
from ftcore.commands import Change, Clear, Switch
from ftcore.identifiers import ID_PATTERN
from server.openapi import TAGS

BENT = [".", "..", "...", "a.b", ".a", "a/b", "/", "../faults", "%2e%2e", "..%2f", "a b", " ", "", "a?b", "a#b", "a;b",
        "a\\b", "f1\n", "f1\r\nx: y", "\x00", "é", "-a", "_a", "x" * 61]  # fmt: skip
FAULT = {"channel": "ruler.position.x", "kind": "bias", "magnitude": 1.0}


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=62) | st.from_regex(ID_PATTERN, fullmatch=True))
def test_an_id_that_is_taken_arrives_as_it_is_whatever_a_client_does_to_paths(id: str) -> None:
    try:
        Fault(id=id, channel="x", kind="bias")
    except ValidationError:
        assert re.fullmatch(ID_PATTERN[1:-1], id, re.ASCII) is None
        return
    base = "http://127.0.0.1:8000/api/v1/experiments/3f2a9c01/faults/"
    for sent in (urlsplit(urljoin(base, id)).path, httpx.URL(base + id).raw_path.decode()):
        assert sent == urlsplit(base).path + id


@pytest.mark.parametrize("id", BENT)
def test_an_id_that_bends_a_path_is_refused_wherever_a_document_has_one(flight: Flight, id: str) -> None:
    answers = [
        flight.ask("POST", "/faults", FAULT | {"id": id}),
        *(
            flight.client.post(f"{API}/experiments", json={"scenario": toy.scenario(**part)})
            for part in (
                {"faults": [FAULT | {"id": id}]},
                {"commands": [{"action": "inject", "time": 1.0, "fault": FAULT | {"id": id}}]},
                {"commands": [{"action": "change", "time": 1.0, "fault": id, "fields": {"magnitude": 2.0}}]},
                {"commands": [{"action": "clear", "time": 1.0, "fault": id}]},
            )
        ),
    ]
    for answer in answers:
        assert answer.status_code == 422
        assert "1 to 60 letters" in answer.json()["detail"]
    named = flight.client.post(f"{API}/experiments", json={"scenario": toy.scenario(id=id)})
    assert named.status_code == 422
    assert flight.get()["faults"] == []
    assert [one["id"] for one in flight.client.get(f"{API}/experiments").json()] == [flight.id]


@pytest.mark.parametrize("form", [Change, Clear, Switch])
def test_commands_name_nothing_that_no_fault_or_subsystem_can_be_called(form: Any) -> None:
    action = form.__name__.lower()
    rest = {"change": {"fields": {}}, "clear": {}, "switch": {"enabled": True}}[action]
    where = "subsystem" if form is Switch else "fault"
    for name in ("..", "a/b", ""):
        with pytest.raises(ValidationError, match="letters"):
            form.model_validate({"action": action, "time": 0.0, where: name} | rest)


def test_an_empty_id_in_a_path_is_nobody_and_clears_nothing(flight: Flight) -> None:
    flight.do("POST", "/faults", FAULT | {"start": 5.0})
    for path in (
        f"{flight.path}/faults/",
        f"{flight.path}/",
        f"{flight.path}/faults//",
        f"{flight.path}/faults/%2e%2e",
    ):
        answer = flight.client.request("DELETE", path, follow_redirects=True)
        assert answer.status_code in (404, 405), path
    assert flight.get()["faults"][0]["state"] == "armed"


def test_everything_that_describes_itself_has_names_that_fit_into_a_path() -> None:
    for system in catalogue.systems():
        for name in [system.id, *(s.name for s in system.subsystems), *(c.name for c in system.channels)]:
            assert urlsplit(urljoin("http://x/a/", name)).path == f"/a/{name}"
    for scenario in catalogue.scenarios():
        assert re.fullmatch(ID_PATTERN, scenario.id)
    assert all(re.fullmatch(ID_PATTERN, tag) for tag in TAGS)


@pytest.mark.parametrize(
    "title", ["two\nlines", "\x1b[31mred", "bell\x07", "\x00", "\x85", "\u2028", "\u202eevil", "\ud800"]
)
def test_a_title_is_one_line_that_a_terminal_can_show(flight: Flight, title: str) -> None:
    for body in ({"scenario": toy.scenario(title=title)}, {"scenario": toy.scenario(), "title": title}):
        answer = flight.client.post(
            f"{API}/experiments", content=json.dumps(body), headers={"content-type": "application/json"}
        )
        assert answer.status_code == 422
        assert "title" in answer.json()["errors"][0]["field"] or title == "\ud800"  # that is not even JSON
    assert flight.ask("POST", "/fork", {"title": title.replace("\ud800", "\x7f")}).status_code == 422


@pytest.mark.parametrize("title", ["{{data}}", "{{style}}", "</title><script>alert(1)</script>", "a & b", "{{title}}"])
def test_a_title_that_looks_like_a_place_of_the_report_is_only_a_title(client: TestClient, title: str) -> None:
    plain = Flight(client, title="plain").client.get
    report = plain(f"{Flight(client, title=title).path}/report").text
    shown = title.replace("&", "&amp;").replace("<", "&lt;")
    assert f"<title>{shown}</title>" in report
    assert report.count('<script type="application/json" id="data">{"title"') == 1
    assert "<script>alert" not in report


@pytest.mark.parametrize("where", ["/faults", "/rewind", "/advance", "/fork"])
def test_half_a_character_is_refused_wherever_it_stands(flight: Flight, where: str) -> None:
    for body in ({"\ud800": 1}, {"title": "\ud800"}, {"to": "\ud800"}, {"kind": "\ud800"}, ["\ud800"]):
        content, headers = json.dumps(body), {"content-type": "application/json"}
        answer = flight.client.post(f"{flight.path}{where}", content=content, headers=headers)
        assert answer.status_code == 422
        assert answer.json()["errors"]
    answer = flight.client.request("PATCH", f"{flight.path}/settings", content='{"\\ud800": 1}', headers=headers)
    assert answer.status_code in (409, 422)


def test_text_of_several_lines_may_stand_in_a_summary() -> None:
    assert Scenario.model_validate(toy.scenario(summary="one\n\ttwo")).summary == "one\n\ttwo"
    with pytest.raises(ValidationError, match="control characters"):
        Scenario.model_validate(toy.scenario(summary="one\x1b[2Jtwo"))
