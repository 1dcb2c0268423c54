"""The ledger: what is written by name lies under that name, and nothing else can be written."""

import numpy as np
import pytest

from ftcore import Scenario, Simulation
from ftcore.description import Chart, SceneItem, Trace
from ftcore.description import Test as Declaration
from ftcore.parts.declared import DeclarationError, Declared, Signals, channels_of, describe
from ftcore.parts.ledger import Layout, Ledger, LedgerError
from ftcore.scenario import ready_ids
from ftcore.systems.registry import SYSTEMS

RADARS = Declared(
    members={"radar": {"a": "Radar A", "b": "Radar B"}, "axis": {"x": "x", "y": "y", "z": "z"}},
    roles={"radar": {"a": "protected", "b": "local"}},
    channels=channels_of(
        "radar.range",
        "Range of {}",
        {"a": "Radar A", "b": "Radar B"},
        sensor="radar.{}",
        unit="m",
        kinds=("bias",),
        typical=10.0,
    ),
    subjects={"radar": "all radars", "radar.{radar}": "{radar}"},
    signals=(
        Signals("range", "mean range", "m", "radar"),
        Signals("{radar}.off.{axis}", "{radar}, {axis} error", "m", "error"),
    ),
    tests=(
        Declaration(
            name="spread",
            label="spread test",
            subjects=("radar", "radar.{radar}"),
            dof="1",
            source="FTLab",
            probability="exact",
        ),
    ),
    charts=(
        Chart(
            id="off-{axis}",
            title="Error, {axis}",
            unit="m",
            group="errors",
            traces=(Trace(signal="{radar}.off.{axis}", label="{radar}", sigma="{radar}.off.{axis}"),),
        ),
    ),
    scene=(SceneItem(id="ray.{radar}", label="{radar}", kind="vector", family="rays", channel="radar.range.{radar}"),),
)
LAYOUT = Layout(RADARS)


def value(say, name):
    return say.row[:, [s.name for s in LAYOUT.signals].index(name)]


def test_given_a_pattern_then_every_member_lies_under_its_own_name():
    say = Ledger(LAYOUT, runs=2)
    off = np.arange(12.0).reshape(2, 2, 3)
    say["{radar}.off.{axis}"] = off
    say["range"] = [7.0]
    assert np.array_equal(value(say, "range"), [7.0, 7.0])
    for i, radar in enumerate("ab"):
        for k, axis in enumerate("xyz"):
            assert np.array_equal(value(say, f"{radar}.off.{axis}"), off[:, i, k])
    assert np.array_equal(say["{radar}.off.{axis}"], off)
    assert np.count_nonzero(say.written) == 7


def test_given_some_members_then_the_others_have_no_number():
    say = Ledger(LAYOUT, runs=1)
    say.test("spread", "radar.{radar}", [[4.0]], [[9.0]], [[1]], [[True]], columns=np.array([1]))
    assert value(say, "test.spread.radar.b.statistic") == 4.0
    assert value(say, "test.spread.radar.b.threshold") == 9.0
    assert value(say, "test.spread.radar.b.alarm") == 1.0
    assert np.isnan(value(say, "test.spread.radar.a.statistic"))
    assert value(say, "test.spread.radar.a.dof") == value(say, "test.spread.radar.a.alarm") == 0.0


def test_health_and_use_lie_under_their_subject():
    say = Ledger(LAYOUT, runs=2)
    say.judge("radar.{radar}", [[0, 2], [1, 0]], [[True, False], [True, True]])
    say.judge("radar", [2], [True])
    by_name = dict(zip(LAYOUT.subjects, say.health.T.tolist(), strict=True))
    assert by_name == {"radar": [2, 2], "radar.a": [0, 1], "radar.b": [2, 0]}
    used = dict(zip(LAYOUT.subjects, say.used.T.tolist(), strict=True))
    assert used == {"radar": [True, True], "radar.a": [True, True], "radar.b": [False, True]}


def test_scene_items_are_drawn_by_name():
    say = Ledger(LAYOUT, runs=1)
    say.draw("ray.{radar}", np.arange(6.0).reshape(2, 3))
    assert {k: v.tolist() for k, v in LAYOUT.vectors(say.drawn).items()} == {"ray.a": [0, 1, 2], "ray.b": [3, 4, 5]}


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda say: say.__setitem__("rang", [1.0]), "no signal 'rang' is declared; near it: range"),
        (lambda say: say.__setitem__("a.off.x", [1.0]), r"near it: \{radar\}.off.\{axis\}"),
        (lambda say: say.__setitem__("range", 1.0), r"range is written as \(\); \(2 or 1\) is declared"),
        (lambda say: say.__setitem__("range", [1.0, 2.0, 3.0]), r"\(3,\); \(2 or 1\) is declared"),
        (lambda say: say.__setitem__("{radar}.off.{axis}", np.zeros((2, 3, 2))), r"\(2 or 1, 2, 3\) is declared"),
        (lambda say: say.test("spraed", "radar", [1], [1], [1], [0]), "no test 'spraed of radar' is declared; near it"),
        (lambda say: say.test("spread", "radar.a", [1], [1], [1], [0]), "no test 'spread of radar.a' is declared"),
        (lambda say: say.judge("rader", [0], [True]), "no subject 'rader' is declared; near it: radar"),
        (lambda say: say.draw("ray", np.zeros(3)), r"no scene item 'ray' is declared; near it: ray.\{radar\}"),
        (lambda say: say.draw("ray.{radar}", np.zeros(3)), r"drawn as \(3,\); \(2, 3\) is declared"),
    ],
)
def test_what_is_not_declared_or_of_another_shape_is_refused_and_changes_nothing(write, words):
    say = Ledger(LAYOUT, runs=2)
    with pytest.raises(LedgerError, match=words):
        write(say)
    assert np.array_equal(say.row, np.repeat(LAYOUT.blank[None], 2, axis=0), equal_nan=True)
    assert not say.written.any()
    assert not say.drawn


def test_what_is_written_twice_is_refused():
    say = Ledger(LAYOUT, runs=1)
    say["range"] = [1.0]
    with pytest.raises(LedgerError, match="range is written twice"):
        say["range"] = [1.0]


def test_a_copy_is_written_on_without_changing_what_was_said():
    say = Ledger(LAYOUT, runs=1)
    say.copy()["range"] = [1.0]
    assert np.isnan(say["range"]).all()


def test_a_description_names_every_member():
    d = describe(
        RADARS, shown=("off-z",), id="radars", title="Radars", summary="", source="FTLab", epoch=1.0, estimators={},
        settings_schema={}, parameters_schema={},
    )  # fmt: skip
    assert [(c.name, c.label, c.sensor, c.parts) for c in d.channels] == [
        ("radar.range.a", "Range of Radar A", "radar.a", (0,)),
        ("radar.range.b", "Range of Radar B", "radar.b", (1,)),
    ]
    assert d.tests[0].subjects == ("radar", "radar.a", "radar.b")
    assert [(c.id, c.shown) for c in d.charts] == [("off-z", True), ("off-x", False), ("off-y", False)]
    trace = d.charts[0].traces[0]
    assert (trace.signal, trace.label, trace.role, trace.sigma) == ("a.off.z", "Radar A", "protected", "a.off.z")
    assert d.charts[0].traces[1].sigma is None
    labels = {s.name: s.label for s in d.signals}
    assert labels["b.off.y"] == "Radar B, y error"
    assert labels["test.spread.radar.b.dof"] == "spread test, Radar B: dof"
    assert [(i.id, i.channel) for i in d.scene] == [("ray.a", "radar.range.a"), ("ray.b", "radar.range.b")]


def test_declarations_that_contradict_each_other_are_refused():
    with pytest.raises(DeclarationError, match=r"other members"):
        RADARS + Declared(members={"radar": {"a": "Radar A"}})
    with pytest.raises(DeclarationError, match="range is declared twice"):
        (RADARS + Declared(signals=(Signals("range", "", "m", ""),))).all_signals()
    with pytest.raises(DeclarationError, match=r"nobody declares the members of \{lidar\}"):
        Declared(signals=(Signals("{lidar}.range", "", "m", ""),)).all_signals()
    with pytest.raises(DeclarationError, match="chart none is to be shown"):
        describe(RADARS, shown=("none",), id="radars", title="", summary="", source="", epoch=1.0)


def test_every_declared_name_is_written_in_some_ready_scenario():
    unsaid: dict[str, set[str]] = {}
    for id in ready_ids():
        sim = Simulation(Scenario.load(id)).step()
        truth, output = sim._shown
        names = sim._assembly.reporter.complete(truth, output).unsaid()
        unsaid[sim.description.id] = unsaid.get(sim.description.id, names) & names
    assert set(unsaid) == set(SYSTEMS)
    assert not any(unsaid.values()), unsaid
