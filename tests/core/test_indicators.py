"""Figures before anything flies: a mounting's indices, and the map of faults that parity space cannot place."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.stats import binom

from ftcore import Scenario, Simulation, catalogue
from ftcore.detection import ambiguity, geometry, parity
from ftcore.detection.geometry import cluster, three_two_dof
from ftcore.systems.base import Indicated
from ftcore.systems.registry import SYSTEMS

SIGMA = 0.01


def ask(mounting=(45.0, 45.0, 45.0), noise=SIGMA, **settings):
    parameters = {"gyros": {"mounting": list(mounting), "noise": noise}}
    return {i.id: i for i in catalogue.indicators("redundant-imu", parameters, settings)}


def test_the_mounting_of_the_paper_is_ideal():
    found = ask()
    assert found["fdi"].value == pytest.approx(found["fdi"].ideal) == pytest.approx(4.0)  # (28)
    assert found["gnc"].value == pytest.approx(found["gnc"].ideal) == pytest.approx(1 / np.sqrt(8.0))
    assert found["planes"].value == pytest.approx(found["planes"].ideal) == pytest.approx(90.0)
    assert found["axis-margin"].value == pytest.approx(found["axis-margin"].ideal) == pytest.approx(45.0)


def test_no_mounting_is_better_than_ideal():
    for angles in np.random.default_rng(1).uniform(0.0, 180.0, (50, 3)):
        for indicator in ask(angles).values():
            if indicator.ideal is not None:
                better = 1.0 if indicator.better == "higher" else -1.0
                assert better * (indicator.value - indicator.ideal) <= 1e-9 * max(1.0, abs(indicator.ideal))


def test_turned_mounting_shows_what_it_costs():
    """At 0 deg each input axis is parallel to one of another gyro: a single fault is as ambiguous as can be."""
    found = ask((0.0, 0.0, 0.0))
    assert found["fdi"].value == pytest.approx(1.0)
    assert found["axis-margin"].value == pytest.approx(0.0, abs=1e-6)
    assert found["gnc"].value == pytest.approx(found["gnc"].ideal)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.0, 3.2), min_size=3, max_size=3), st.floats(1.0, 44.0))
def test_bands_are_what_a_fine_map_shows(angles, degrees):
    reference = parity.uncalibrated(three_two_dof(*angles), SIGMA, 0.0)
    limit = np.deg2rad(degrees)
    angle, FI, _ = ambiguity.ambiguity_map(reference, limit, 720)
    for k, bands in enumerate(ambiguity.ambiguous_bands(reference, limit)):
        for other in {0, 1, 2} - {k}:
            inside = np.zeros(len(angle), bool)
            for start, end, whose in bands:
                assert 0.0 <= start <= end <= np.pi + 1e-12
                if whose == other:
                    inside |= (angle >= start) & (angle <= end)
            sure = np.abs(FI[k, :, other] - limit) > 1e-6
            np.testing.assert_array_equal(inside[sure], (FI[k, :, other] < limit)[sure])


def test_bands_where_planes_do_not_meet_or_are_the_same():
    rng = np.random.default_rng(2)
    pairs = [np.linalg.qr(rng.normal(size=(3, 2)))[0].T for _ in range(5)]
    many = parity.uncalibrated(cluster([*pairs, [0.0, 0.0, 1.0]]), SIGMA, 0.0)
    limit = np.deg2rad(35.0)
    _, FI, _ = ambiguity.ambiguity_map(many, limit, 3600)
    bands = ambiguity.ambiguous_bands(many, limit)
    assert bands[5] == ()  # one axis: no plane of its own
    for k in range(5):
        for other in set(range(6)) - {k}:
            length = sum(end - start for start, end, whose in bands[k] if whose == other)
            assert length == pytest.approx(np.pi * (FI[k, :, other] < limit).mean(), abs=4e-3)
    # Two instruments share the one dimension there is: whatever the fault, both explain it.
    two = parity.uncalibrated(cluster([np.eye(3)[:2], [[0, 1, 1], [1, 1, -1]]]), SIGMA, 0.0)
    assert ambiguity.ambiguous_bands(two) == (((0.0, np.pi, 1),), ((0.0, np.pi, 0),))


def test_a_third_of_all_faults_is_ambiguous_at_any_mounting_but_not_the_same_third():
    for mounting, bands in (
        ((45.0, 45.0, 45.0), [(30.0, 60.0, "gyro 3"), (120.0, 150.0, "gyro 2")]),
        ((60.0, 45.0, 45.0), [(15.0, 45.0, "gyro 3"), (105.0, 135.0, "gyro 2")]),
    ):
        found = ask(mounting)["ambiguous.1"]
        assert found.value == pytest.approx(100.0 / 3.0)
        seen = [(band.start, band.end, band.label) for band in found.map.bands]
        assert [band[2] for band in seen] == [band[2] for band in bands]
        np.testing.assert_allclose([b[:2] for b in seen], [b[:2] for b in bands], atol=1e-9)
    assert ask(angle_threshold=30.0)["ambiguous.2"].value == pytest.approx(200.0 / 3.0)
    assert ask(angle_threshold=44.0)["ambiguous.2"].value == pytest.approx(100.0 * 176.0 / 180.0)


def test_the_least_fault_is_seen_in_its_first_epoch_as_often_as_said():
    found = ask(noise=0.02, false_alarm_probability=0.01)["least-fault"]
    reference = parity.uncalibrated(three_two_dof(), 0.02, 0.0)
    readings = 0.02 * np.random.default_rng(3).normal(size=(50_000, 6)) + [0, 0, 0, found.value, 0, 0]
    seen = parity.parity_test(reference, readings, 0.01, ("set", "1", "2", "3"))[0].alarm
    low, high = binom.ppf([5e-7, 1 - 5e-7], seen.size, 0.99)
    assert low <= seen.sum() <= high


def test_angles_between_planes_are_those_of_their_normals():
    instruments = three_two_dof(0.3, 1.1, 0.7)
    found = geometry.plane_angles(instruments)
    V = instruments.V
    normals = [np.cross(V[:, 2 * k], V[:, 2 * k + 1]) for k in range(3)]
    for angle, (a, b) in zip(found, [(0, 1), (0, 2), (1, 2)], strict=True):
        assert np.linalg.norm(np.cross(normals[a], normals[b])) / np.linalg.norm(normals[a]) / np.linalg.norm(
            normals[b]
        ) == pytest.approx(np.sin(angle))
    skew = cluster([[[1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 0.8, 0.6]], [[0, 1, 1], [1, 0, 0]]])
    V = skew.V
    normals = [np.cross(V[:, 2 * k], V[:, 2 * k + 1]) for k in range(3)]
    cosine = [abs(normals[a] @ normals[b]) / np.linalg.norm(normals[a]) / np.linalg.norm(normals[b])
              for a, b in ((0, 1), (0, 2), (1, 2))]  # fmt: skip
    np.testing.assert_allclose(np.cos(geometry.plane_angles(skew)), cosine, atol=1e-12)


def test_indices_are_those_that_the_flight_records():
    mounting = [30.0, 60.0, 10.0]
    sim = Simulation(
        Scenario(system="redundant-imu", duration=0.1, parameters={"gyros": {"mounting": mounting}})
    ).advance()
    assert sim["geometry.fdi"][-1, 0] == pytest.approx(ask(mounting)["fdi"].value)


def test_the_other_redundant_imu_has_them_too_and_a_system_without_any_says_none():
    found = {i.id: i for i in catalogue.indicators("sins-gps-doppler", {"inertial": {"mounting": [0.0, 0.0, 0.0]}})}
    assert found["fdi"].value == pytest.approx(1.0)
    assert found["fdi"].field == "inertial.mounting"
    assert catalogue.indicators("gps-receiver") == ()


def test_every_indicator_points_at_a_parameter_that_exists():
    for id, system in SYSTEMS.items():
        if not isinstance(system, Indicated):
            continue
        found = catalogue.indicators(id)
        assert len({i.id for i in found}) == len(found)
        for indicator in found:
            assert (indicator.ideal is None) or indicator.better
            here = system.Parameters()
            for part in (indicator.field or "").split("."):
                here = getattr(here, part) if part else here


def test_refused_values_are_located():
    with pytest.raises(catalogue.CatalogueError, match="redundant-imu"):
        catalogue.indicators("f-15")
    with pytest.raises(ValidationError) as refused:
        catalogue.indicators("redundant-imu", {"gyros": {"mounting": [45.0, "45", 45.0]}}, {"angle_threshold": 90.0})
    places = [e["loc"] for e in refused.value.errors()]
    assert places == [("parameters", "gyros", "mounting", 1), ("settings", "angle_threshold")]
