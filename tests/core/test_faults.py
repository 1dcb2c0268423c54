"""The fault catalogue: each kind does what its sentence says, faults add up, clearing restores."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from ftcore.faults import ALL_KINDS, KINDS, ChannelAddress, Fault, FaultError, check
from ftcore.injection import FaultMemory, apply
from ftcore.noise import NoiseSource
from ftcore.readings import Group, Readings

CHANNELS = {
    "a.q.1": ChannelAddress("a.q.1", "a.q", (0,), "m", ALL_KINDS, "a"),
    "a.q.2": ChannelAddress("a.q.2", "a.q", (1,), "m", ALL_KINDS, "a"),
    "a.q.all": ChannelAddress("a.q.all", "a.q", (0, 1), "m", ALL_KINDS, "a"),
    "fast.q.1": ChannelAddress("fast.q.1", "fast.q", (0,), "mg", ("bias", "ramp", "stuck", "delay"), "fast"),
}
RUNS, SAMPLES = 3, 4


def clean(epoch):
    """A signal that is easy to recognise: part index + time, for both groups."""
    time = float(epoch)
    fast = time - 1.0 + (np.arange(SAMPLES) + 0.5) / SAMPLES
    slow = np.array([[100.0 + time, 200.0 + time]]).repeat(RUNS, axis=0)
    return Readings(
        time,
        {
            "a.q": Group(slow, np.ones((1, 2), bool), np.asarray(time)),
            "fast.q": Group(np.broadcast_to(fast, (RUNS, 1, SAMPLES)).copy(), np.ones((1, 1), bool), fast),
        },
    )


def fly(faults, epochs, noise=None):
    """Readings of epochs 1..epochs with the faults laid over."""
    memory, out = FaultMemory(), []
    noise = noise or NoiseSource(1, range(RUNS))
    for epoch in range(1, epochs + 1):
        memory, readings, _ = apply(faults, CHANNELS, memory, clean(epoch), noise, epoch, 1.0)
        out.append(readings)
    return out


def fault(kind, magnitude=0.0, channel="a.q.1", start=3.0, **more):
    """A fault, with a magnitude if its kind has one."""
    if KINDS[kind].uses("magnitude"):
        more["magnitude"] = magnitude
    return Fault(id=more.pop("id", "f1"), channel=channel, kind=kind, start=start, **more)


def slow(readings, part=0):
    return np.array([r["a.q"].values[0, part] for r in readings])


def test_given_a_bias_then_it_is_there_from_start_to_end_only():
    flown = slow(fly([fault("bias", 5.0, end=6.0)], 8)) - slow(fly([], 8))
    np.testing.assert_array_equal(flown, [0, 0, 5, 5, 5, 0, 0, 0])


def test_given_a_ramp_then_it_grows_by_the_magnitude_each_second():
    flown = slow(fly([fault("ramp", 2.0)], 6)) - slow(fly([], 6))
    np.testing.assert_allclose(flown, [0, 0, 0, 2, 4, 6])


def test_given_a_sine_then_it_starts_at_zero_at_onset():
    flown = slow(fly([fault("sine", 7.0, angular_frequency=0.5)], 6)) - slow(fly([], 6))
    np.testing.assert_allclose(flown[2:], 7.0 * np.sin(0.5 * np.arange(4)), atol=1e-12)


def test_given_a_scale_factor_then_the_reading_is_stretched():
    np.testing.assert_allclose(slow(fly([fault("scale-factor", 0.1)], 4))[3], 1.1 * 104.0)


def test_given_stuck_then_the_last_good_value_is_held():
    np.testing.assert_array_equal(slow(fly([fault("stuck", end=6.0)], 7)), [101, 102, 102, 102, 102, 106, 107])


def test_given_stuck_on_a_fast_channel_then_the_last_sample_before_onset_is_held():
    flown = fly([fault("stuck", channel="fast.q.1", start=2.0)], 4)
    np.testing.assert_array_equal(flown[3]["fast.q"].values[0, 0], [1.875] * SAMPLES)


def test_given_a_delay_then_the_reading_is_an_older_one():
    np.testing.assert_allclose(slow(fly([fault("delay", 1.5, start=5.0)], 7))[4:], [103.5, 104.5, 105.5])


def test_given_a_dropout_then_only_that_part_is_invalid():
    flown = fly([fault("dropout", end=5.0)], 5)
    assert [bool(r["a.q"].valid[0, 0]) for r in flown] == [True, True, False, False, True]
    assert all(r["a.q"].valid[0, 1] for r in flown)


def test_given_noise_then_its_spread_is_the_magnitude_and_its_mean_zero():
    added = slow(fly([fault("noise", 3.0, start=0.0)], 4000)) - slow(fly([], 4000))
    # 4000 samples: both bounds fail by chance with probability below 1e-5.
    assert abs(added.std() / 3.0 - 1.0) < 0.05
    assert abs(added.mean()) < 4.5 * 3.0 / np.sqrt(4000)


def test_given_outliers_then_they_come_at_the_rate_with_the_size():
    added = slow(fly([fault("outliers", 50.0, start=0.0, rate=0.2)], 4000)) - slow(fly([], 4000))
    assert set(np.round(np.unique(added), 9)) == {-50.0, 0.0, 50.0}
    # binomial(4000, 0.2): +-4.5 sigma.
    assert abs(np.count_nonzero(added) - 800) < 4.5 * np.sqrt(4000 * 0.2 * 0.8)


def test_given_a_random_walk_then_its_variance_grows_with_time():
    runs = range(2000)
    memory, noise = FaultMemory(), NoiseSource(1, runs)
    for epoch in range(1, 17):
        reading = Readings(
            float(epoch), {"a.q": Group(np.zeros((2000, 2)), np.ones((1, 2), bool), np.asarray(float(epoch)))}
        )
        memory, flown, _ = apply([fault("random-walk", 2.0, start=0.5)], CHANNELS, memory, reading, noise, epoch, 1.0)
    # Standard deviation 2 sqrt(16) = 8; with 2000 runs 4.5 sigma is 7 %.
    assert abs(flown["a.q"].values[:, 0].std() / 8.0 - 1.0) < 0.075


def test_given_several_faults_on_one_channel_then_they_add_up_and_each_can_go():
    both = [fault("bias", 5.0), fault("ramp", 1.0, id="f2")]
    added = slow(fly(both, 6)) - slow(fly([], 6))
    np.testing.assert_allclose(added, [0, 0, 5, 6, 7, 8])
    np.testing.assert_array_equal(slow(fly(both[:1], 6)) - slow(fly([], 6)), [0, 0, 5, 5, 5, 5])


def test_given_a_group_channel_then_every_part_is_touched():
    flown = fly([fault("bias", 5.0, channel="a.q.all")], 3)
    np.testing.assert_array_equal(flown[2]["a.q"].values[0], [108.0, 208.0])


def test_given_an_onset_inside_an_epoch_then_only_later_samples_are_touched():
    flown = fly([fault("bias", 1.0, channel="fast.q.1", start=1.5)], 2)
    added = flown[1]["fast.q"].values[0, 0] - clean(2)["fast.q"].values[0, 0]
    np.testing.assert_allclose(added, [0, 0, 9.80665e-3, 9.80665e-3])


def test_given_a_datasheet_unit_then_it_is_converted():
    flown = fly([fault("bias", 1000.0, channel="fast.q.1", start=0.0, unit="ug")], 1)
    np.testing.assert_allclose(flown[0]["fast.q"].values[0, 0] - clean(1)["fast.q"].values[0, 0], 9.80665e-3)


@given(
    kind=st.sampled_from(ALL_KINDS),
    start=st.floats(0, 6),
    length=st.floats(0.01, 5),
    magnitude=st.floats(0.01, 5.0),
)
def test_given_any_fault_when_it_has_ended_then_the_channel_is_truly_restored(kind, start, length, magnitude):
    one = fault(kind, magnitude, start=start, end=start + length)
    flown, healthy = fly([one], 14), fly([], 14)
    for got, want in zip(flown, healthy, strict=True):
        if got.time >= start + length + 1.0:
            np.testing.assert_array_equal(got["a.q"].values, want["a.q"].values)
            assert got["a.q"].valid.all()
        np.testing.assert_array_equal(got["a.q"].values[:, 1], want["a.q"].values[:, 1])


def test_given_a_fault_then_the_clean_readings_are_not_changed():
    reading = clean(3)
    before = reading["a.q"].values.copy()
    apply([fault("bias", 5.0)], CHANNELS, FaultMemory(), reading, NoiseSource(1, range(RUNS)), 3, 1.0)
    np.testing.assert_array_equal(reading["a.q"].values, before)


@pytest.mark.parametrize(
    ("wrong", "field", "says"),
    [
        ({"channel": "a.q.9"}, "channel", "a.q.1"),
        ({"channel": "fast.q.1", "kind": "noise", "magnitude": 1.0}, "kind", "it takes bias, ramp"),
        ({"unit": "deg"}, "unit", "m, km, ft"),
        ({"kind": "ramp", "unit": "m"}, "unit", "m/s"),
        ({"magnitude": 0.0}, "magnitude", "changes nothing"),
        ({"kind": "noise", "magnitude": -1.0}, "magnitude", "positive"),
        ({"kind": "delay", "magnitude": 60.0}, "magnitude", "at most 10 s"),
        ({"magnitude": 1e9}, "magnitude", "at most 1e+07 m"),
        ({"magnitude": 1e5, "unit": "km"}, "magnitude", "at most 10000 km"),
        ({"kind": "ramp", "magnitude": -2e7}, "magnitude", "at most 1e+07 m/s"),
    ],
)
def test_given_a_fault_the_channel_cannot_take_then_it_is_refused_with_the_reason(wrong, field, says):
    with pytest.raises(FaultError) as refused:
        check(Fault(**({"channel": "a.q.1", "kind": "bias", "magnitude": 1.0, "start": 0.0} | wrong)), CHANNELS)
    assert refused.value.field == field
    assert says in str(refused.value)


@pytest.mark.parametrize(
    "wrong",
    [
        {"magnitude": float("nan")},
        {"magnitude": float("inf")},
        {"kind": "explode"},
        {"start": -1.0},
        {"start": 5.0, "end": 4.0},
        {"colour": "red"},
    ],
)
def test_given_a_malformed_fault_then_it_is_refused(wrong):
    with pytest.raises(ValidationError):
        Fault(**({"channel": "a.q.1", "kind": "bias", "magnitude": 1.0} | wrong))


@pytest.mark.parametrize("kind", ALL_KINDS)
@pytest.mark.parametrize("field", ["magnitude", "unit", "angular_frequency", "rate"])
def test_given_a_field_that_its_kind_has_no_use_for_then_the_fault_is_refused_by_name(kind, field):
    given = {"channel": "a.q.1", "kind": kind, field: "m" if field == "unit" else 0.5}
    if KINDS[kind].uses(field):
        assert field in Fault(**given).model_dump()
        return
    with pytest.raises(ValidationError) as refused:
        Fault(**given)
    assert [error["loc"] for error in refused.value.errors()] == [(field,)]
    assert f"a {kind} fault" in str(refused.value)
    default = Fault.model_fields[field].default
    assert field not in Fault(**{**given, field: default}).model_dump(), "a default says nothing, old documents have it"


@pytest.mark.parametrize("kind", ALL_KINDS)
def test_given_a_fault_then_its_document_makes_the_same_fault_again(kind):
    one = fault(kind, 2.0, end=9.0)
    assert Fault.model_validate_json(one.model_dump_json()) == one
    assert Fault.model_validate(one.model_dump()) == one


# ---- what acts, and what does not


def effects(faults, epochs, reading=clean):
    """Per epoch: fault id -> (acts, why not)."""
    memory, noise, found = FaultMemory(), NoiseSource(1, range(RUNS)), []
    for epoch in range(1, epochs + 1):
        memory, _, effect = apply(faults, CHANNELS, memory, reading(epoch), noise, epoch, 1.0)
        found.append({id: (bool(e.changed[0].any()), e.because) for id, e in effect.items()})
    return found


@given(
    kind=st.sampled_from(ALL_KINDS),
    start=st.floats(0, 6),
    length=st.floats(0.01, 5),
    magnitude=st.floats(1e-18, 5.0),
    other=st.sampled_from([None, *ALL_KINDS]),
)
def test_given_any_fault_then_it_acts_where_the_readings_differ_from_those_without_it_and_else_says_why(
    kind, start, length, magnitude, other
):
    one = fault(kind, magnitude, start=start, end=start + length)
    others = [] if other is None else [fault(other, 2.0, start=3.0, id="f2")]
    with_it, without = fly([one, *others], 10), fly(others, 10)
    for now, got, want in zip(effects([one, *others], 10), with_it, without, strict=True):
        valid = got["a.q"].valid[0, 0], want["a.q"].valid[0, 0]
        differs = valid[0] != valid[1] or (valid[0] and got["a.q"].values[0, 0] != want["a.q"].values[0, 0])
        acts, because = now.get("f1", (False, "not live"))
        repeated = kind == other == "dropout" and acts  # the first of two acts, though the second would do it too
        assert acts == differs or repeated
        assert (because is None) == acts


@pytest.mark.parametrize(
    ("faults", "says"),
    [
        ([fault("bias", 1e-18)], "below the last bit"),
        ([fault("ramp", 1.0)], "the ramp is zero"),
        ([fault("sine", 1.0)], "the sine is zero"),
        ([fault("outliers", 1.0, rate=1e-9)], "no spike"),
        ([fault("delay", 1.0, start=1.0)], "nothing older"),
        ([fault("stuck", start=1.0)], "the very value that is held"),
        ([fault("bias", 1.0), fault("dropout", id="f2")], "dropout f2 covers it"),
        ([fault("bias", 1.0), fault("stuck", id="f2", channel="a.q.all")], "stuck fault f2 covers it"),
        ([fault("stuck"), fault("stuck", id="f2")], "stuck fault f2 covers it"),
    ],
)
def test_given_a_fault_that_changes_nothing_then_it_says_why(faults, says):
    epoch = 1 if faults[0].start == 1.0 else 3
    acts, because = effects(faults, epoch)[-1]["f1"]
    assert not acts
    assert says in because


def test_given_a_reading_that_is_not_there_then_a_fault_does_not_act():
    def absent(epoch):
        there = clean(epoch)
        group = there["a.q"]
        return Readings(
            there.time, {**there.groups, "a.q": Group(group.values, np.array([[False, True]]), group.times)}
        )

    for kind in ALL_KINDS:
        acts, because = effects([fault(kind, 1.0, rate=1.0)] if kind == "outliers" else [fault(kind, 1.0)], 5, absent)[
            -1
        ]["f1"]
        assert not acts
        assert "not in view" in because


def test_given_two_dropouts_or_two_stuck_faults_then_one_of_them_acts():
    for kind in ("dropout", "stuck"):
        last = effects([fault(kind), fault(kind, id="f2")], 5)[-1]
        assert [acts for acts, _ in last.values()].count(True) == 1


def test_every_kind_says_what_it_does():
    assert all(info.label and info.sentence for info in KINDS.values())
