"""At home in a notebook: what a value looks like there, charts, tables, progress, names by tab."""

from __future__ import annotations

import doctest
import re
import subprocess
import sys
from html.parser import HTMLParser
from itertools import cycle
from types import ModuleType

import numpy as np
import pytest

import ftcore.display
import ftcore.faults
import ftcore.names
import ftcore.notebook
import ftcore.score.summary
from ftcore import Fault, Scenario, Simulation, catalogue
from ftcore.commands import Configure, Inject, Switch
from ftcore.notebook.looks import THEMES
from ftcore.notebook.marks import stretches

ZHANG = Scenario.load("zhang-1992-visible")
RAIM = Scenario.load("raim-two-faults")
NASTY = '<script>alert("&\'1")</script>'


@pytest.fixture(scope="module")
def zhang() -> Simulation:
    return Simulation(ZHANG, runs=2, first_run=3).advance(until=56.0)


@pytest.fixture(scope="module")
def receiver() -> Simulation:
    return Simulation(RAIM).advance(until=30.0)


# ---- what a value looks like


class Reader(HTMLParser):
    """Checks that every element is closed, and collects text, elements and attributes."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.styles = ""
        self.text = ""
        self.feed(html)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open.append(tag)
        self.tags.add(tag)
        self.styles += "".join(f"{value};" for name, value in attrs if name == "style")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += f" {data}"


def test_a_simulation_says_what_it_is_in_a_line(zhang: Simulation) -> None:
    assert repr(zhang) == (
        "<Simulation zhang-1992-visible: 56 of 100 s, 2 runs, seed 8; faults: 2 active; 282 signals recorded>"
    )


def test_a_scenario_and_a_fault_say_what_they_are_in_a_line() -> None:
    assert repr(ZHANG) == ("<Scenario zhang-1992-visible: sins-gps-doppler, 100 s, seed 8, 2 faults, 0 commands>")
    assert repr(ZHANG.faults[0]) == "<Fault accelerometer: imu.accelerometer.3y bias 1 mg from 30 s>"
    stuck = Fault(channel="gps.pseudorange.C1", kind="stuck", end=9.0)
    assert repr(stuck) == "<Fault without an id yet: gps.pseudorange.C1 stuck from now to 9 s>"


def test_a_score_tells_its_strip_and_its_faults_with_units(zhang: Simulation) -> None:
    told = repr(zhang.score()).splitlines()
    assert told[0] == "<Score of 2 runs, 56 s>"
    assert any(re.match(r"  Altitude error.*: [\d.]+ m ", line) or " m since" in line for line in told)
    assert any("imu.accelerometer.3y bias 1 mg: acted in 2 of 2 runs" in line for line in told)


def _shown(zhang: Simulation) -> dict[str, object]:
    score = zhang.score()
    return {
        "simulation": zhang,
        "scenario": ZHANG,
        "fault": ZHANG.faults[0],
        "score": score,
        "rows per run": score.rows.flights,
        "rows per fault": score.rows.faults,
    }


@pytest.mark.parametrize("name", ["simulation", "scenario", "fault", "score", "rows per run", "rows per fault"])
def test_html_is_well_formed_and_takes_its_colours_from_the_notebook(zhang: Simulation, name: str) -> None:
    read = Reader(_shown(zhang)[name]._repr_html_())  # type: ignore[attr-defined]
    assert read.text.strip()
    colours = re.findall(r"(?<![-\w])(?:color|background)\s*:\s*([^;]+)", read.styles)
    assert set(colours) <= {"inherit", "transparent"}, "so that it reads in the dark and in the light"
    assert "#" not in read.styles


def test_html_tells_faults_with_unit_state_and_effect(zhang: Simulation) -> None:
    text = Reader(zhang._repr_html_()).text
    for said in ("bias 100 m from 50 s", "active", "acting", "2 runs", "56 of 100 s flown", "Alarms and isolations"):
        assert said in text


def test_what_a_person_typed_is_text_and_no_html() -> None:
    scenario = ZHANG.model_copy(update={"title": NASTY, "summary": NASTY, "hint": NASTY, "source": NASTY})
    sim = Simulation(scenario).advance(until=1.0)
    for html in (scenario._repr_html_(), sim._repr_html_(), sim.score()._repr_html_()):
        read = Reader(html)
        assert "script" not in read.tags
        assert "<script" not in html
    assert NASTY in Reader(sim._repr_html_()).text
    figure = sim.plot("altitude error")
    assert "<script" not in figure.layout.title.text


def test_a_scenario_shows_its_commands_as_html() -> None:
    late = Fault(id="late", channel="gps.pseudorange.C1", kind="bias", magnitude=5.0)
    commands = (
        Inject(action="inject", time=3.0, fault=late),
        Switch(action="switch", time=4.0, subsystem="doppler", enabled=False),
        Configure(action="configure", time=5.0, settings={"driving_test": "glr"}),
    )
    text = Reader(ZHANG.model_copy(update={"commands": commands})._repr_html_()).text
    assert "doppler off" in text
    assert "driving_test glr" in text
    assert "gps.pseudorange.C1 bias" in text


def test_every_ready_scenario_shows_itself() -> None:
    for scenario in catalogue.scenarios():
        assert scenario.title in Reader(scenario._repr_html_()).text
        for fault in scenario.faults:
            assert fault.channel in Reader(fault._repr_html_()).text


# ---- charts


def test_a_chart_is_drawn_from_the_declaration_of_the_page(zhang: Simulation) -> None:
    figure = zhang.plot("altitude error", run=1)
    (chart,) = [c for c in zhang.description.charts if c.title == "Altitude error"]
    lines = [trace for trace in figure.data if trace.name and trace.yaxis == "y" and trace.showlegend is not False]
    assert [line.name.removesuffix(" ±3σ") for line in lines] == [trace.label for trace in chart.traces]
    np.testing.assert_array_equal(lines[0].y, zhang[chart.traces[0].signal][:, 1])
    band = next(trace for trace in figure.data if trace.fill == "tonexty")
    np.testing.assert_array_equal(band.y, 3.0 * zhang[chart.traces[0].sigma][:, 1])
    assert figure.layout.yaxis.title.text == "Altitude error, m"
    assert "run 4" in figure.layout.title.text


def test_numbers_are_in_the_unit_that_a_person_is_shown(zhang: Simulation) -> None:
    figure = zhang.plot("attitude-up")
    assert figure.layout.yaxis.title.text == "Azimuth error, mrad"
    line = next(trace for trace in figure.data if trace.name)
    np.testing.assert_allclose(line.y, 1e3 * zhang["fused.error.attitude.up"][:, 0])
    assert line.hovertemplate.endswith(" mrad")


def test_faults_alarms_and_isolations_are_marked(zhang: Simulation) -> None:
    figure = zhang.plot("altitude error")
    assert [(shape.x0, shape.x1) for shape in figure.layout.shapes] == [(30.0, 56.0), (50.0, 56.0)]
    lanes = {trace.name: trace for trace in figure.data if trace.yaxis == "y2"}
    assert set(lanes) == {"fault", "alarm", "isolated"}
    assert any("bias 100 m, 50 to 56 s" in text for text in lanes["fault"].text)
    isolated = next(e for e in zhang.events if (e.kind, e.subject, e.run) == ("subsystem.isolated", "gps", 3))
    assert isolated.time in lanes["isolated"].x
    assert any(text.startswith("GPS isolated, ") for text in lanes["isolated"].text)


def test_marks_are_those_of_the_run_that_is_drawn(zhang: Simulation) -> None:
    for run in (3, 4):
        found = stretches(zhang.events, run, zhang.description)
        raised = [e for e in zhang.events if e.kind == "test.alarmed" and e.run == run]
        assert len([s for s in found if s.kind == "alarm"]) == len(raised)


def test_a_fault_that_was_cleared_or_moved_is_marked_as_it_was() -> None:
    sim = Simulation(ZHANG.model_copy(update={"faults": ()})).advance(until=2.0)
    one = sim.inject(Fault(channel="gps.pseudorange.C1", kind="bias", magnitude=9.0, end=50.0))
    two = sim.inject(Fault(channel="doppler.velocity.x", kind="bias", magnitude=9.0, start=40.0))
    sim.change(one.id, magnitude=3.0)
    sim.advance(until=5.0)
    sim.clear(one.id)
    sim.clear(two.id)
    (found,) = [s for s in stretches(sim.events, 0, sim.description) if s.kind == "fault"]
    assert (found.start, found.end) == (2.0, 5.0)
    assert found.label.endswith("bias 3 m")


def test_signals_are_drawn_by_name_or_pattern_a_row_for_each_unit(zhang: Simulation) -> None:
    figure = zhang.plot("fused.error.position.*", "fused.error.velocity.up", start=10.0, end=20.0)
    titles = [figure.layout[axis].title.text.replace("<br>", " ") for axis in ("yaxis", "yaxis2")]
    assert titles == ["Signals, m", f"{zhang.signals['fused.error.velocity.up'].label}, m/s"]
    names = {trace.name for trace in figure.data if trace.yaxis == "y"}
    assert names == {f"fused.error.position.{axis}" for axis in ("east", "north", "up", "horizontal")}
    assert all(10.0 <= t <= 20.0 for trace in figure.data if trace.yaxis == "y" for t in trace.x)


@pytest.mark.parametrize("id", catalogue.systems(), ids=lambda system: system.id)
def test_every_chart_of_every_system_can_be_drawn(id: object) -> None:
    scenario = next(s for s in catalogue.scenarios() if s.system == id.id)  # type: ignore[attr-defined]
    sim = Simulation(scenario).advance(epochs=3)
    assert list(sim.charts) == [chart.id for chart in sim.description.charts]
    for chart, theme in zip(sim.charts, cycle(THEMES), strict=False):
        figure = sim.plot(chart, theme=theme)
        assert figure.data or figure.layout.annotations[0].text.startswith("no value from "), chart
    assert sim.plot().data


def test_charts_of_a_moment_tell_units_and_regions(receiver: Simulation) -> None:
    sky = receiver.plot("sky")
    assert len(sky.data[0].r) >= 5
    assert all(0.0 <= r <= 90.0 for r in sky.data[0].r)
    plane = receiver.plot("stanford-combined")
    (chart,) = [c for c in receiver.description.charts if c.id == "stanford-combined"]
    assert len(plane.layout.shapes) == len(chart.regions)
    assert plane.layout.xaxis.title.text.endswith(", m")
    with pytest.raises(ValueError, match=r"'Sky' is not drawn over time, so it is drawn alone: plot\('sky'\)"):
        receiver.plot("sky", "hdop")


@pytest.mark.parametrize(
    ("what", "more", "said"),
    [
        (["altitude eror"], {}, "no chart or signal 'altitude eror'; for instance Altitude error"),
        (["fused.error.position.upp"], {}, "for instance fused.error.position.up"),
        (["GLR"], {}, "may be Windowed GLR, SINS/GPS .glr-gps.*say which by its id"),
        (["altitude error"], {"run": 2}, "no run 2; this flight has 2, from 0 on"),
        (["altitude error"], {"start": 80.0}, "nothing is recorded there; the flight is at 56 s"),
        (["altitude error"], {"theme": "blue"}, "no theme 'blue'; there are dark, light"),
    ],
)
def test_what_cannot_be_drawn_is_refused_with_what_can(
    zhang: Simulation, what: list[str], more: dict[str, object], said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        zhang.plot(*what, **more)  # type: ignore[arg-type]


def test_only_what_is_recorded_is_drawn() -> None:
    sim = Simulation(ZHANG, signals=["fused.error.position.up"]).advance(until=2.0)
    assert list(sim.charts) == ["position-up"]
    assert [trace.name for trace in sim.plot().data if trace.name] == ["fault-tolerant"]
    with pytest.raises(ValueError, match="no chart can be drawn from what is recorded"):
        Simulation(ZHANG, signals=[]).advance(until=1.0).plot()


# ---- tables of other packages


def test_a_recording_becomes_a_pandas_frame_with_units(zhang: Simulation) -> None:
    pytest.importorskip("pandas")
    frame = zhang.to_pandas(["fused.error.position.up", "fused.nees"])
    assert list(frame.columns) == ["time", "run", "fused.error.position.up", "fused.nees"]
    assert frame.attrs["units"] == {"time": "s", "run": "1", "fused.error.position.up": "m", "fused.nees": "1"}
    of_run = frame[frame.run == 4]
    np.testing.assert_array_equal(of_run["fused.error.position.up"], zhang["fused.error.position.up"][:, 1])
    np.testing.assert_array_equal(of_run["time"], zhang.time)
    assert len(zhang.to_pandas().columns) == 2 + len(zhang.signals)


def test_a_recording_becomes_a_polars_frame(zhang: Simulation) -> None:
    pytest.importorskip("polars")
    frame = zhang.to_polars(["fused.error.position.up"])
    assert frame.columns == ["time", "run", "fused.error.position.up"]
    assert frame.height == 2 * 56


def test_a_recording_becomes_an_xarray_over_time_and_run(zhang: Simulation) -> None:
    pytest.importorskip("xarray")
    data = zhang.to_xarray(["fused.error.position.*"])
    up = data["fused.error.position.up"]
    np.testing.assert_array_equal(up.sel(run=4), zhang["fused.error.position.up"][:, 1])
    assert up.attrs["units"] == "m"
    assert float(up.sel(time=30.0, run=3)) == zhang["fused.error.position.up"][29, 0]


def test_rows_of_a_score_become_a_frame(zhang: Simulation) -> None:
    pytest.importorskip("pandas")
    rows = zhang.score().rows
    frame = rows.faults.to_pandas()
    assert frame.run.tolist() == [3, 3, 4, 4]
    assert frame.attrs["units"]["isolation_delay"] == "s"
    assert frame.groupby("fault").isolation_delay.median()["satellite"] == zhang.score().faults[1].time_to_isolate


@pytest.mark.parametrize(
    ("package", "call"),
    [
        ("pandas", lambda sim: sim.to_pandas()),
        ("polars", lambda sim: sim.to_polars()),
        ("xarray", lambda sim: sim.to_xarray()),
        ("pandas", lambda sim: sim.score().rows.flights.to_pandas()),
        ("polars", lambda sim: sim.score().rows.flights.to_polars()),
        ("plotly", lambda sim: sim.plot("altitude error")),
        ("tqdm", lambda sim: sim.fork().advance(epochs=1, progress=True)),
    ],
)
def test_a_package_that_is_missing_is_named(
    zhang: Simulation, monkeypatch: pytest.MonkeyPatch, package: str, call: object
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    if package == "tqdm":
        monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    with pytest.raises(ImportError, match=f"the package {package}, .*pip install {package}"):
        call(zhang)  # type: ignore[operator]


def test_a_name_that_is_not_recorded_is_refused_with_near_misses(zhang: Simulation) -> None:
    with pytest.raises(ValueError, match=r"no signal 'fused.eror.position.up'; for instance fused.error.position.up"):
        zhang.to_pandas(["fused.eror.position.up"])


def test_the_core_imports_without_any_of_them() -> None:
    kept_out = ("plotly", "pandas", "polars", "xarray", "tqdm", "IPython", "matplotlib")
    code = (
        f"import sys; [sys.modules.__setitem__(name, None) for name in {kept_out}]; import ftcore; "
        "s = ftcore.Simulation(ftcore.Scenario.load('kim-2005')).advance(epochs=2); "
        "print(len(s._repr_html_()) > 100, s)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("True <Simulation kim-2005: 0.04 of 15 s")


# ---- progress and names


def test_progress_is_told_to_a_function_after_each_epoch() -> None:
    told: list[tuple[float, float]] = []
    Simulation(ZHANG).advance(until=2.0).advance(until=5.0, progress=lambda now, end: told.append((now, end)))
    assert told == [(3.0, 5.0), (4.0, 5.0), (5.0, 5.0)]


def test_progress_is_a_bar_on_demand_and_changes_no_bit(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("tqdm")
    quiet = Simulation(ZHANG).advance(until=3.0)
    assert capsys.readouterr() == ("", "")
    told = Simulation(ZHANG).advance(until=3.0, progress=True)
    assert "3 of 3 s" in capsys.readouterr().err
    np.testing.assert_array_equal(told.recording.rows, quiet.recording.rows)


def test_a_function_that_raises_stops_the_flight_between_two_epochs() -> None:
    class Enough(Exception):
        pass

    def stop(now: float, end: float) -> None:
        raise Enough

    sim = Simulation(ZHANG)
    with pytest.raises(Enough):
        sim.advance(until=5.0, progress=stop)
    assert sim.now == 1.0
    np.testing.assert_array_equal(
        sim.advance(until=3.0).recording.rows, Simulation(ZHANG).advance(until=3.0).recording.rows
    )


def test_names_are_completed_by_tab(zhang: Simulation) -> None:
    assert zhang._ipython_key_completions_() == list(zhang.signals)
    assert {"plot", "charts", "score", "advance", "signals", "to_pandas"} <= set(dir(zhang))
    assert "acted" in zhang.score().rows.faults._ipython_key_completions_()


def test_a_name_that_is_not_there_is_answered_with_near_misses(zhang: Simulation) -> None:
    with pytest.raises(KeyError, match=r"no signal 'fused.error.position.upp'; for instance fused.error.position.up"):
        zhang["fused.error.position.upp"]
    with pytest.raises(KeyError, match="no column 'isolation_dely'; for instance isolation_delay"):
        zhang.score().rows.faults["isolation_dely"]


@pytest.mark.parametrize(
    "module",
    [ftcore.display, ftcore.faults, ftcore.names, ftcore.notebook, ftcore.score.summary],
    ids=lambda module: module.__name__,
)
def test_examples_in_docstrings_run(module: ModuleType) -> None:
    done = doctest.testmod(module)
    assert done.attempted > 0
    assert done.failed == 0
