"""Any random schedule of faults, in any system, under any driving test and master: nobody stays locked out.

A few schedules of each system in the quick suite; 300 (`long`), of which the ten worst are printed with what flies them
again. An aircraft's minute has 3000 epochs, so of those the quick suite flies one.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import pytest

from tests.papers.schedules import AFTER, KINDS, Finding, draw, fly, worst

SCHEDULES = 300
QUICK = {
    "sins-gps-doppler": (0, 1, 2),
    "gps-receiver": (0, 1, 2),
    "redundant-imu": (0,),
    "sins-gps-bd2-cns": (0, 1, 2),
}
flown = cache(fly)


def of(system: str, numbers: Iterable[int]) -> list[Finding]:
    return [flown(system, number) for number in numbers]


@pytest.mark.parametrize("system", KINDS)
def test_schedules_are_of_every_sort(system):
    """Every channel family and kind, every choice of every setting, one to four faults, at once and returning."""
    drawn = [draw(system, number) for number in range(SCHEDULES)]
    faults = [fault for scenario in drawn for fault in scenario.faults]
    assert {f.kind for f in faults} == {kind for c in drawn[0].model.description.channels for kind in c.kinds}
    assert {len(s.faults) for s in drawn} == {1, 2, 3, 4}
    assert any(len({f.start for f in s.faults}) < len(s.faults) for s in drawn)
    assert any(len({f.channel for f in s.faults}) < len(s.faults) for s in drawn)
    for name, field in drawn[0].model.description.settings_schema["properties"].items():
        choices = set(field.get("enum", ())) - {value for key, value in KINDS[system].unguarded if key == name}
        assert choices <= {s.settings.get(name) for s in drawn}
    assert all(s.duration >= max(f.end for f in s.faults if f.end) + AFTER for s in drawn)
    assert draw(system, 7) == draw(system, 7) != draw(system, 8)


@pytest.mark.parametrize("system", KINDS)
def test_given_a_few_schedules_then_nobody_is_locked_out_and_the_errors_are_as_small_as_said(system):
    wrong = [finding for finding in of(system, QUICK[system]) if not finding.fine]
    assert not wrong, "\n".join(map(str, wrong))


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("system", KINDS)
def test_given_any_of_300_schedules_then_nobody_is_locked_out_and_the_errors_are_as_small_as_said(system):
    findings = of(system, range(SCHEDULES))
    print(f"\n{system}, the ten worst:\n{worst(findings)}")
    wrong = [finding for finding in findings if not finding.fine]
    assert not wrong, f"{len(wrong)} of {SCHEDULES}:\n{worst(wrong, len(wrong))}"
