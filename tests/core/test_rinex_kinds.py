"""What stands in a RINEX file is read, or refused by line and cause: the kinds of trouble that the field brings."""

import gzip

import numpy as np
import pytest

from ftcore.sensors import rinex, rinex_navigation, rinex_observation
from ftcore.sensors.rinex import LogError
from ftcore.sensors.rinex_text import date, seconds_of
from ftcore.sensors.rinex_unpack import unpack
from tests import packing
from tests.daily_log import daily
from tests.synthetic_log import files

MADE = files(6)
NAVIGATION = MADE.navigation.decode()


def header(*records: tuple[str, str]) -> str:
    return "".join(f"{text:60s}{label}\n" for text, label in (*records, ("", "END OF HEADER")))


POSITION = (" -3044803.8094  4043820.7723  3867447.4610", "APPROX POSITION XYZ")
FIRST_2 = ("     2.11           OBSERVATION DATA    M (MIXED)", "RINEX VERSION / TYPE")
FIRST_3 = ("     3.04           OBSERVATION DATA    M: MIXED", "RINEX VERSION / TYPE")
HEAD_2 = header(FIRST_2, ("     2    C1    P1", "# / TYPES OF OBSERV"), POSITION)
HEAD_3 = header(FIRST_3, ("G    2 C1C C1W", "SYS / # / OBS TYPES"), ("R    1 C1C", "SYS / # / OBS TYPES"), POSITION)


def number(value: float | None) -> str:
    return " " * 16 if value is None else f"{value:14.3f}  "


def epoch2(second: float, ranges: dict[str, tuple[float | None, ...]], flag: int = 0, minute: int = 0) -> str:
    names = "".join(ranges)
    lines = [f" 26  3  4 10 {minute:2d}{second:11.7f}  {flag}{len(ranges):3d}{names[:36]}"]
    lines += [" " * 32 + names[k : k + 36] for k in range(36, len(names), 36)]
    lines += ["".join(number(value) for value in values).rstrip() for values in ranges.values()]
    return "\n".join(lines) + "\n"


def epoch3(second: float, ranges: dict[str, tuple[float | None, ...]], flag: int = 0, minute: int = 0) -> str:
    lines = [f"> 2026 03 04 10 {minute:02d}{second:11.7f}  {flag}{len(ranges):3d}"]
    lines += [name + "".join(number(value) for value in values).rstrip() for name, values in ranges.items()]
    return "\n".join(lines) + "\n"


def event(flag: int, *records: tuple[str, str], version: int = 2) -> str:
    body = "".join(f"{text:60s}{label}\n" for text, label in records)
    return (
        (f"{'>' if version == 3 else '':28s}" + (" " * 3 if version == 3 else "")) + f"{flag}{len(records):3d}\n" + body
    )


def read(text: str | bytes):
    content = text.encode() if isinstance(text, str) else text
    return rinex_observation.read(unpack(content, "observation file", 10**8), 100)


A, B, C = 2.1e7 + 0.125, 2.2e7 + 0.25, 2.3e7 + 0.5
TWO = {"G05": (A, None), "G07": (B, None)}


def ranges(observed, *satellites: int) -> list[list[float]]:
    return [[float(row[s - 1]) for s in satellites] for row in observed.pseudorange]


# ---- times


@pytest.mark.parametrize(
    ("parts", "reads"),
    [
        (("26", "3", "4", "10", "59", "60.0000000"), "2026-03-04 11:00:00"),
        (("26", "3", "4", "23", "59", "60.0000000"), "2026-03-05 00:00:00"),
        (("24", "2", "28", "23", "59", "60.0"), "2024-02-29 00:00:00"),
        (("25", "2", "28", "23", "59", "60.0"), "2025-03-01 00:00:00"),
        (("99", "12", "31", "23", "59", "60.0"), "2000-01-01 00:00:00"),
        (("26", "3", "4", "24", "0", "0.0"), "2026-03-05 00:00:00"),
        (("26", "3", "4", "10", "60", "0.0"), "2026-03-04 11:00:00"),
        (("80", "1", "6", "0", "0", "0.0"), "1980-01-06 00:00:00"),
        (("79", "1", "6", "0", "0", "0.0"), "2079-01-06 00:00:00"),
    ],
)
def test_given_a_full_second_minute_or_hour_then_it_is_the_next_one(parts, reads):
    seconds = seconds_of(parts, True)
    assert seconds is not None
    assert date(seconds) == reads


@pytest.mark.parametrize(
    "parts",
    [
        ("26", "2", "30", "0", "0", "0.0"),
        ("26", "13", "1", "0", "0", "0.0"),
        ("26", "1", "0", "0", "0", "0.0"),
        ("26", "1", "1", "25", "0", "0.0"),
        ("26", "1", "1", "0", "61", "0.0"),
        ("26", "1", "1", "0", "0", "60.5"),
        ("26", "1", "1", "0", "0", "-1.0"),
        ("26", "1", "1", "0", "", "0.0"),
        ("26", "1", "1", "0", "0", "nan"),
    ],
)
def test_given_what_is_no_time_then_it_is_none(parts):
    assert seconds_of(parts, True) is None


# ---- epochs, flags and events


@pytest.mark.parametrize(("head", "epoch"), [(HEAD_2, epoch2), (HEAD_3, epoch3)])
def test_given_a_power_failure_or_an_external_event_then_the_epochs_are_read(head, epoch):
    version = 2 if head == HEAD_2 else 3
    observed = read(head + epoch(0.0, TWO) + event(5, version=version) + epoch(30.0, TWO, flag=1))
    assert ranges(observed, 5, 7) == [[A, B]] * 2
    assert any("lost power before 2026-03-04 10:00:30" in note for note in observed.notes)


@pytest.mark.parametrize(("head", "epoch"), [(HEAD_2, epoch2), (HEAD_3, epoch3)])
def test_given_cycle_slips_then_they_are_no_epoch(head, epoch):
    observed = read(head + epoch(0.0, TWO) + epoch(0.0, {"G05": (1.0, 2.0)}, flag=6) + epoch(30.0, TWO))
    assert ranges(observed, 5, 7) == [[A, B]] * 2


@pytest.mark.parametrize(("head", "epoch"), [(HEAD_2, epoch2), (HEAD_3, epoch3)])
def test_given_an_antenna_that_starts_to_move_then_it_is_refused_if_anything_follows(head, epoch):
    version = 2 if head == HEAD_2 else 3
    still = head + epoch(0.0, TWO) + event(2, version=version)
    assert len(read(still).stamps) == 1
    line = still.count("\n")
    with pytest.raises(LogError, match=f"receiver that moves: event flag 2 at line {line}"):
        read(still + epoch(30.0, TWO))
    with pytest.raises(LogError, match="event flag 2"):
        read(head + event(2, version=version) + epoch(30.0, TWO))


def test_given_a_new_site_then_the_same_place_is_read_and_another_or_an_unknown_one_is_refused():
    name = ("SITE", "MARKER NAME")
    begun = HEAD_2 + epoch2(0.0, TWO)
    assert len(read(begun + event(3, name, POSITION) + epoch2(30.0, TWO)).stamps) == 2
    assert len(read(begun + event(3, name)).stamps) == 1
    with pytest.raises(LogError, match="event flag 3, a new site at line"):
        read(begun + event(3, name) + epoch2(30.0, TWO))
    with pytest.raises(LogError, match="another approximate position"):
        read(begun + event(4, (" -3044803.8094  4043820.7723  3868447.4610", POSITION[1])) + epoch2(30.0, TWO))
    first = read(
        HEAD_2 + event(3, name, (" -3044000.0000  4043820.7723  3867447.4610", POSITION[1])) + epoch2(0.0, TWO)
    )
    assert first.position is not None
    assert first.position[0] == -3044000.0
    near = read(begun + event(4, (" -3044803.8094  4043825.7723  3867447.4610", POSITION[1])) + epoch2(30.0, TWO))
    assert any("changes by 5.0 m" in note for note in near.notes)


def test_given_a_new_list_of_observables_then_the_numbers_of_either_side_are_read_by_their_own():
    swapped = {"G05": (None, A), "G07": (C, B)}
    observed = read(
        HEAD_2 + epoch2(0.0, TWO) + event(4, ("     2    P1    C1", "# / TYPES OF OBSERV")) + epoch2(30.0, swapped)
    )
    assert ranges(observed, 5, 7) == [[A, B]] * 2
    longer = {"G05": (None, None, None, None, None, A), "G07": (None, None, None, None, None, B)}
    observed = read(
        HEAD_2
        + epoch2(0.0, TWO)
        + event(4, ("     6    L1    L2    P2    D1    S1    C1", "# / TYPES OF OBSERV"))
        + " 26  3  4 10  0 30.0000000  0  2G05G07\n"
        + "".join(" " * 80 + "\n" + number(values[5]) + "\n" for values in longer.values())
    )
    assert ranges(observed, 5, 7) == [[A, B]] * 2
    new = event(4, ("G    3 L1C D1C C1C", "SYS / # / OBS TYPES"), version=3)
    observed = read(HEAD_3 + epoch3(0.0, TWO) + new + epoch3(30.0, {"G05": (None, 1.0, A), "G07": (2.0, None, B)}))
    assert ranges(observed, 5, 7) == [[A, B]] * 2


def test_given_a_second_header_or_comments_inside_a_file_then_they_are_followed():
    other = HEAD_2.replace("     2    C1    P1", "     2    P1    C1")
    comment = f"{'spliced here':60s}COMMENT\n"
    text = HEAD_2 + epoch2(0.0, TWO) + comment + other + comment + epoch2(30.0, {"G05": (None, A), "G07": (None, B)})
    observed = read(text)
    assert ranges(observed, 5, 7) == [[A, B]] * 2
    assert any("another header stands at line" in note for note in observed.notes)
    lines = epoch2(0.0, TWO).splitlines(keepends=True)
    within = HEAD_2 + lines[0] + comment + lines[1] + comment + comment + lines[2]
    assert ranges(read(within + epoch2(30.0, TWO)), 5, 7) == [[A, B]] * 2
    with pytest.raises(LogError, match=r"corrupt at line 8: # / TYPES OF OBSERV, a line of a header"):
        read(HEAD_2 + epoch2(0.0, TWO) + f"{'     2    P1    C1':60s}# / TYPES OF OBSERV\n" + epoch2(30.0, TWO))


def test_given_more_than_twelve_satellites_then_the_names_go_on_and_other_systems_are_left_alone():
    many = {f"{s}{k:02d}": (A + k, None) for k in range(1, 11) for s in "GRE"}
    observed = read(HEAD_2 + epoch2(0.0, many) + epoch2(30.0, many))
    assert ranges(observed, *range(1, 11)) == [[A + k for k in range(1, 11)]] * 2
    assert np.isfinite(observed.pseudorange).sum() == 20


def test_given_blank_and_lower_case_names_and_a_clock_offset_then_they_are_read():
    text = HEAD_2 + f" 26  3  4 10  0  0.0000000  0  2  5g 7{'':30s}{0.000123:12.9f}\n{number(A)}\n{number(B)}\n"
    assert ranges(read(text), 5, 7) == [[A, B]]
    low = HEAD_3.replace("G    2 C1C C1W", "g    2 c1c c1w").replace("END OF HEADER", "end of header")
    assert ranges(read(low + epoch3(0.0, {"g05": (A, None), "g 7": (B, None)})), 5, 7) == [[A, B]]
    glonass = HEAD_2.replace("M (MIXED)", "R (GLONA)") + epoch2(0.0, {"  5": (A, None), "G07": (B, None)})
    assert np.isnan(read(glonass).pseudorange[0, 4])


# ---- codes and scales


@pytest.mark.parametrize(("head", "epoch", "code"), [(HEAD_2, epoch2, "P1"), (HEAD_3, epoch3, "C1W")])
def test_given_a_blank_or_zero_code_then_the_next_one_is_read_by_satellite_and_said(head, epoch, code):
    some = {"G05": (None, A), "G07": (B, B + 1.0), "G08": (0.0, C)}
    observed = read(head + epoch(0.0, some) + epoch(30.0, some))
    assert ranges(observed, 5, 7, 8) == [[A, B, C]] * 2
    assert any(
        f"{code} is read where" in note and "4 of 6 pseudoranges, of G05, G08" in note for note in observed.notes
    )


def test_given_scale_factors_then_they_are_taken_out():
    scaled = HEAD_3.replace(f"{'':60s}END", f"{'G  100  1 C1C':60s}SYS / SCALE FACTOR\n{'':60s}END")
    hundred = {"G05": (A * 100.0, None), "G07": (None, C)}
    observed = read(scaled + epoch3(0.0, hundred))
    np.testing.assert_allclose(ranges(observed, 5, 7), [[A, C]], rtol=1e-15)
    everything = HEAD_3.replace(f"{'':60s}END", f"{'G   10':60s}SYS / SCALE FACTOR\n{'':60s}END")
    np.testing.assert_allclose(ranges(read(everything + epoch3(0.0, {"G05": (A * 10.0, None)})), 5), [[A]], rtol=1e-15)
    late = event(4, ("G   10", "SYS / SCALE FACTOR"), version=3)
    observed = read(HEAD_3 + epoch3(0.0, TWO) + late + epoch3(30.0, {"G05": (A * 10.0, None)}))
    np.testing.assert_allclose(ranges(observed, 5), [[A], [A]], rtol=1e-15)
    with pytest.raises(LogError, match="a scale factor is 1, 10, 100 or 1000"):
        read(scaled.replace("G  100", "G    7") + epoch3(0.0, TWO))


def test_given_lists_over_several_lines_then_they_are_joined_and_must_be_complete():
    codes = [f"{k}{b}W" for b in (2, 5) for k in "CLDS"] + ["L1C", "D1C", "S1C", "L1W", "D1W", "C1C"]
    head = header(
        FIRST_3,
        ("G   14 " + " ".join(codes[:13]), "SYS / # / OBS TYPES"),
        ("       " + codes[13], "SYS / # / OBS TYPES"),
    )
    assert ranges(read(head + epoch3(0.0, {"G05": (*([None] * 13), A)})), 5) == [[A]]
    with pytest.raises(LogError, match="announces 14 observables, and 13 are listed"):
        read(head.replace("       C1C", "          ") + epoch3(0.0, TWO))


def test_given_values_that_are_no_distance_then_they_are_left_out_and_said():
    observed = read(HEAD_2 + epoch2(0.0, {"G05": (123.456, None), "G07": (B, None)}))
    assert any("1 value below 1000 km is no distance" in note and "line 6" in note for note in observed.notes)


# ---- characters


def test_given_any_line_ends_marks_or_trailing_blanks_then_the_file_reads_the_same():
    text = HEAD_2 + epoch2(0.0, TWO) + epoch2(30.0, TWO)
    padded = "".join(f"{line:80s}\n" for line in text.splitlines())
    stripped = "".join(line.rstrip() + "\n" for line in text.splitlines())
    for content in (
        text.encode(),
        padded.encode(),
        stripped.encode(),
        text.rstrip("\n").encode(),
        text.replace("\n", "\r\n").encode(),
        text.replace("\n", "\r\r\n").encode(),
        text.replace("\n", "\r").encode(),
        b"\xef\xbb\xbf" + text.encode(),
        text.encode("utf-16"),
        text.encode("utf-16-be").join([b"\xfe\xff", b""]),
        text.encode() + b"\x1a",
        b"\n\n" + text.encode(),
        text.replace("C1    P1", "c1    p1").encode(),
    ):
        assert ranges(read(content), 5, 7) == [[A, B]] * 2


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8"])
def test_given_names_with_letters_beyond_ascii_then_labels_are_found_all_the_same(encoding):
    comment = f"{'Müller, Zürich, Île':60s}OBSERVER / AGENCY\n"
    position = f"{'':60s}END OF HEADER\n"
    text = HEAD_2.replace(position, comment + position) + epoch2(0.0, TWO)
    assert ranges(read(text.encode(encoding)), 5, 7) == [[A, B]]


def test_given_a_file_that_was_cut_off_then_it_is_refused_and_not_read_in_part():
    text = HEAD_2 + epoch2(0.0, TWO) + epoch2(30.0, TWO)
    for cut in (text[:-6], text[:-17], text[: text.rindex(" 26  3") + 20]):
        with pytest.raises(LogError, match=r"truncated|corrupt at line"):
            read(cut)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD_2 + epoch2(0.0, TWO).replace("  0  2", "  9  2"), "line 5: an epoch's flag"),
        (HEAD_2 + epoch2(0.0, TWO).replace("  0  2G05G07", ""), "line 5: the number of its satellites"),
        (HEAD_2 + epoch2(0.0, TWO).replace(" 3  4 10", "13  4 10"), "line 5: an epoch's date and time"),
        (HEAD_2 + epoch2(0.0, TWO).replace("G07", "G?7"), "line 5: the name of satellite 2 of 2"),
        (HEAD_2 + epoch2(0.0, TWO).replace("22000000.250", "22000x00.250"), "line 7: its C1 is not a number"),
        (HEAD_3 + epoch3(0.0, TWO).replace("G07", "?07"), "line 8: a satellite's record"),
        (HEAD_3 + epoch3(0.0, TWO).replace("G07", "G?7"), "line 8: a satellite's number"),
        (HEAD_3 + epoch3(0.0, TWO).replace("> 2026", "  2026"), "line 6: an epoch's line was expected"),
        (HEAD_2.replace("2.11", "2.x1"), "is RINEX"),
        (HEAD_2.replace("2.11", "4.01"), "is RINEX 4.01; versions 2 and 3 are read"),
        (HEAD_2.replace("     2    C1", "          C1"), "line 2: a list of observables begins without"),
    ],
)
def test_given_what_cannot_be_read_then_line_and_cause_are_named(text, says):
    with pytest.raises(LogError, match=says.replace("?", r"\?")) as refused:
        read(text + epoch2(30.0, TWO) if text.startswith(HEAD_2[:20]) else text)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("system", "reads"), [("GPS", True), ("GAL", True), ("GLO", False), ("BDT", False)])
def test_given_another_time_system_then_it_is_refused_unless_it_keeps_gps_time(system, reads):
    record = f"{f'  2026     3     4    10     0    0.0000000     {system}':60s}TIME OF FIRST OBS\n"
    text = HEAD_3.replace(f"{'':60s}END", f"{record}{'':60s}END") + epoch3(0.0, TWO)
    if reads:
        assert len(read(text).stamps) == 1
    else:
        with pytest.raises(LogError, match=f"keeps {system} time"):
            read(text)


# ---- epochs on a grid


def test_given_epochs_twice_out_of_order_or_between_the_grid_then_it_is_said():
    head, *epochs = MADE.observation.decode().split(" 26 03 04 ")
    whole = rinex.parse(MADE.observation, MADE.navigation)

    def parsed(*order: int):
        return rinex.parse((head + "".join(" 26 03 04 " + epochs[k] for k in order)).encode(), MADE.navigation)

    log = parsed(0, 1, 3, 2, 4, 5)
    np.testing.assert_array_equal(log.pseudorange, whole.pseudorange)
    assert any("not in the order of time" in note for note in log.notes)
    log = parsed(0, 1, 2, 2, 3, 4, 5)
    np.testing.assert_array_equal(log.pseudorange, whole.pseudorange)
    assert any("1 epoch is twice" in note for note in log.notes)
    log = parsed(0, 1, 3, 4, 5)
    assert len(log) == 6
    assert np.isnan(log.pseudorange[2]).all()
    shifted = epochs[2].replace("10 01  0.0", "10 01 10.0")
    extra = head + "".join(" 26 03 04 " + one for one in (*epochs[:3], shifted, *epochs[3:]))
    log = rinex.parse(extra.encode(), MADE.navigation)
    assert any("1 of 7 epochs lie between those of a 30 s grid" in note for note in log.notes)
    np.testing.assert_array_equal(log.pseudorange, whole.pseudorange)


def test_given_two_halves_of_an_epoch_then_they_are_one():
    left = epoch2(0.0, {"G05": (A, None)}) + epoch2(0.0, {"G07": (B, None)}) + epoch2(30.0, TWO)
    observed = rinex._merged(read(HEAD_2 + left))
    assert [[row[4], row[6]] for row in observed[1]] == [[A, B]] * 2


# ---- navigation


def sets(prn: int, text: str = NAVIGATION):
    ephemerides = rinex_navigation.read(text.encode()).ephemerides
    return ephemerides, np.flatnonzero(ephemerides.prn == prn)


def record(prn: int) -> list[str]:
    lines = NAVIGATION.splitlines(keepends=True)
    at = next(i for i, line in enumerate(lines) if line.startswith(f"{prn:2d} 26"))
    return lines[at : at + 8]


def test_given_exponents_of_any_letter_then_the_numbers_are_the_same():
    for letter in "dEe":
        e, _ = sets(10, NAVIGATION.replace("D+", f"{letter}+").replace("D-", f"{letter}-"))
        assert all(np.array_equal(e.values[name], sets(10)[0].values[name]) for name in e.values)


def test_given_a_set_that_lacks_a_number_then_it_is_left_out_and_said_and_a_blank_health_is_said_too():
    own = record(10)
    for row, column, name in ((1, 60, "M0"), (2, 22, "Eccentricity"), (3, 41, "Omega0"), (0, 22, "SVclockBias")):
        line = own[row]
        changed = NAVIGATION.replace(
            "".join(own), "".join([*own[:row], line[:column] + " " * 19 + line[column + 19 :], *own[row + 1 :]])
        )
        read_ = rinex_navigation.read(changed.encode())
        assert 10 not in read_.ephemerides.prn
        assert any("ephemeris of G10 at line" in note and f"lacks its {name}" in note for note in read_.notes)
    line = own[6]
    blank = NAVIGATION.replace("".join(own), "".join([*own[:6], line[:22] + " " * 19 + line[41:], own[7]]))
    read_ = rinex_navigation.read(blank.encode())
    assert 10 in read_.ephemerides.prn
    assert any("says no health; it counts as healthy" in note for note in read_.notes)


def test_given_navigation_files_joined_with_headers_and_comments_inside_then_all_sets_are_read():
    once, _ = sets(10)
    joined, own = sets(10, NAVIGATION + f"{'joined':60s}COMMENT\n" + NAVIGATION)
    assert len(joined) == 2 * len(once)
    assert len(own) == 2


@pytest.mark.parametrize("lines", [4, 5])
def test_given_records_of_other_systems_of_any_length_then_they_are_passed_over(lines):
    own = record(10)
    row = "    " + " 1.000000000000D+00" * 4 + "\n"
    glonass = f"R05 2026 03 04 10 00 00{own[0][22:]}" + row * (lines - 1)
    sbas = f"S20 2026 03 04 10 00 00{own[0][22:]}" + row * 3
    galileo = f"E05 2026 03 04 10 00 00{own[0][22:]}" + row * 7
    gps = f"G10 2026 03 04 10 00 00{own[0][22:]}" + "".join(" " + line for line in own[1:])
    head = header(("     3.05           NAVIGATION DATA     M: MIXED", "RINEX VERSION / TYPE"))
    e, _ = sets(10, head + glonass + gps + sbas + galileo + gps + glonass)
    assert e.prn.tolist() == [10, 10]
    with pytest.raises(LogError, match=r"has only 7 of 8 lines"):
        sets(10, head + gps[: gps.rindex("    ")].rsplit("\n", 1)[0] + "\n" + sbas)


def test_given_sets_in_turn_then_the_newest_transmitted_rules_whatever_its_time_of_ephemeris():
    """Healthy at toe, newer and unhealthy with an older toe, newer still and healthy: each rules while it is newest."""
    own, toe = record(10), 3 * 86400.0 + 10 * 3600.0

    def one(sent: float, health: float, shift: float, toe_shift: float = 0.0) -> str:
        lines = own.copy()
        lines[3] = lines[3][:3] + f"{toe + toe_shift:19.12E}" + lines[3][22:]
        lines[6] = lines[6][:22] + f"{health:19.12E}" + lines[6][41:]
        lines[7] = "   " + f"{sent:19.12E}" + lines[7][22:]
        lines[0] = lines[0][:22] + f"{shift:19.12E}" + lines[0][41:]
        return "".join(lines)

    head = NAVIGATION[: NAVIGATION.index("END OF HEADER") + 14]
    text = head + one(toe - 3600.0, 0.0, 1e-5) + one(toe - 3000.0, 63.0, 2e-5, -16.0) + one(toe + 600.0, 0.0, 3e-5)
    e, _ = sets(10, text)
    base = float(e.toe[0])
    chosen = e.valid(10, base + np.array([-5000.0, -3300.0, -2990.0, 0.0, 590.0, 610.0, 7100.0, 7300.0]))
    bias = [float(e.values["SVclockBias"][i]) if i >= 0 else None for i in chosen]
    # Before the first is known the one of the nearest time of ephemeris stands in, here the unhealthy one.
    assert bias == [None, 1e-5, None, None, None, 3e-5, 3e-5, None]


def test_given_the_end_of_a_week_then_times_of_ephemeris_and_transmission_fall_into_the_right_one():
    own = record(10)
    head = NAVIGATION[: NAVIGATION.index("END OF HEADER") + 14]
    own[0] = own[0].replace("26 03 04 10 00", "26 03 08 00 00")  # Sunday
    own[3] = own[3][:3] + f"{0.0:19.12E}" + own[3][22:]
    for sent in (597600.0, -7200.0, 9.999e8):
        own[7] = "   " + f"{sent:19.12E}" + own[7][22:]
        e, _ = sets(10, head + "".join(own))
        assert date(e.toe[0]) == "2026-03-08 00:00:00"
        assert date(e.sent[0]) == "2026-03-07 22:00:00"


# ---- packed files, and large ones


@pytest.mark.parametrize("how", ["gz", "Z", "bz2", "crx", "crx.gz", "crx.Z"])
def test_given_a_packed_file_then_it_reads_like_the_plain_one(how):
    again = rinex.parse(packing.packed(MADE.observation, how), packing.packed(MADE.navigation, how[-2:]))
    np.testing.assert_array_equal(again.pseudorange, rinex.parse(MADE.observation, MADE.navigation).pseudorange)


def test_given_a_small_file_that_unpacks_to_a_huge_one_then_it_is_stopped_at_the_limit():
    heavy = MADE.observation + b" " * 3_000_000
    for how in ("gz", "Z", "bz2"):
        with pytest.raises(LogError, match="unpacks to more than 1 MB"):
            unpack(packing.packed(heavy, how), "observation file", 1_000_000)
    crx = packing.packed(MADE.observation, "crx")
    with pytest.raises(LogError, match="unpacks to more than 0 MB"):
        unpack(crx, "observation file", len(crx) + 100)


@pytest.mark.parametrize("how", ["gz", "Z", "bz2", "crx"])
def test_given_a_packed_file_that_is_damaged_or_cut_off_then_it_is_refused_in_one_sentence(how):
    packed = packing.packed(MADE.observation, how)
    for cut in (3, 10, len(packed) // 3, len(packed) - 9):
        with pytest.raises(LogError) as refused:
            rinex.parse(packed[:cut], MADE.navigation)
        assert "\n" not in str(refused.value)
        assert refused.value.part == "observation"
    with pytest.raises(LogError, match="compressed by zip"):
        rinex.parse(b"PK\x03\x04" + packed, MADE.navigation)
    with pytest.raises(LogError, match="packed more than 3 times"):
        rinex.parse(gzip.compress(gzip.compress(gzip.compress(gzip.compress(MADE.observation)))), MADE.navigation)


def test_given_an_ordinary_daily_file_then_every_pseudorange_is_read():
    """2880 epochs of all systems, 33 MB; `make bench` says how long that takes."""
    made = daily()
    assert 33e6 < len(made.observation) < 35e6
    observed = rinex_observation.read(unpack(made.observation, "observation file", rinex.MAX_OBSERVATION_BYTES), 2880)
    np.testing.assert_array_equal(observed.pseudorange, made.pseudorange)
    np.testing.assert_array_equal(np.diff(observed.stamps), 30.0)
    assert not observed.notes
