"""What a chart, the log and the panels say of events: of the right subject and moment, in numbers that read."""

from __future__ import annotations

from typing import Any

from playwright.sync_api import expect

from .lab import Lab

DESCRIPTION = {
    "subsystems": [], "channels": [], "scene": [], "signals": [],
    "tests": [
        {"name": "residual", "label": "residuals", "subjects": ["gps", "doppler"], "alarm_when": "above", "unit": "1"},
        {"name": "angle", "label": "angle", "subjects": ["imu.gyro.1"], "alarm_when": "below", "unit": "1"},
    ],
}  # fmt: skip


def _event(index: int, time: float, kind: str, subject: str, **detail: Any) -> dict[str, Any]:
    return {"index": index, "time": time, "run": 0, "kind": kind, "subject": subject, "detail": detail}


EVENTS = [
    _event(0, 10.0, "subsystem.isolated", "imu.gyro.1", alarms=[]),
    _event(1, 20.0, "test.alarmed", "gps.C1", test="residual", statistic=30.0, threshold=16.0),
    _event(2, 21.0, "subsystem.isolated", "gps", alarms=[]),
    _event(3, 25.0, "test.cleared", "gps.C1", test="residual", statistic=3.0, threshold=16.0),
]
RAILS = """async ([events, description, signal]) => {
  const { derive } = await import('/static/marks.js');
  const { drawn, rails } = await import('/static/panels/overlay.js');
  const { spans } = derive(events, description);
  const chart = { traces: [{ signal }] };
  return { rails: rails(spans, chart, description, 0.1).map((s) => `${s.row} ${s.start}`),
    lines: drawn(spans, 30, 0.1).marks.filter((m) => m.kind === 'isolated').map((m) => m.time) };
}"""


def test_rails_tell_of_the_subjects_of_their_chart_and_every_isolation_has_a_line(lab: Lab) -> None:
    def told(signal: str) -> Any:
        return lab.page.evaluate(RAILS, [EVENTS, DESCRIPTION, signal])

    assert told("test.residual.gps.statistic") == {"rails": ["alarmed 20", "isolated 21"], "lines": [10, 21]}
    assert told("test.residual.doppler.statistic")["rails"] == []
    assert told("test.angle.imu.gyro.1.statistic")["rails"] == ["isolated 10"]
    assert told("fused.error.position.up")["rails"] == ["alarmed 20", "isolated 10"]


def test_numbers_of_the_log_say_which_way_a_test_alarms(lab: Lab) -> None:
    def reason(kind: str, **detail: Any) -> str:
        event = _event(0, 1.0, kind, "imu.gyro.1", **detail)
        call = "([event, description]) => import('/static/marks.js').then((m) => m.reason(event, description))"
        return str(lab.page.evaluate(call, [event, DESCRIPTION]))

    assert reason("test.alarmed", test="residual", statistic=30.0, threshold=16.0) == "30 > 16"
    assert reason("test.alarmed", test="residual", statistic=0.508, threshold=10.8) == "0.508 below 10.8"
    assert reason("test.cleared", test="residual", statistic=3.0, threshold=16.0) == "3 < 16"
    assert reason("test.alarmed", test="angle", statistic=2.0, threshold=15.0) == "2 below 15"
    assert reason("test.cleared", test="angle", statistic=17.0, threshold=15.0) == "17 above 15"
    assert reason("test.cleared", test="angle", statistic=14.1, threshold=15.0) == "14.1 below 15, no longer asked"
    assert reason("test.alarmed", test="residual", statistic=7.49e-35, threshold=0.0) == "0 just above 0"
    alarms = [{"test": "residual", "statistic": 3086.0, "threshold": 39.3}]
    assert reason("subsystem.readmitted", alarms=alarms) == "tests until then: residuals 3086 > 39.3"


def test_what_does_not_follow_the_cursor_says_that_it_shows_now(lab: Lab) -> None:
    lab.without_scene()
    lab.fly_until(70.0)
    tags = lab.page.locator(".now-tag")
    expect(tags.first).to_be_hidden()
    lab.look_at_start()
    for panel in ("ft-score", "ft-faults", "ft-subsystems"):
        expect(lab.page.locator(f"{panel} .now-tag")).to_have_text(
            r"whole run, to 1:10" if panel == "ft-score" else "now, 1:10"
        )
    expect(lab.page.locator("ft-faults .then")).to_have_text("At 0:00: no fault was live.")
    expect(lab.page.locator("ft-subsystems li", has_text="GPS").first).to_contain_text("; then not isolated")
    expect(lab.page.locator("ft-topbar .of")).to_have_text("is now")
    lab.page.keyboard.press("End")
    expect(tags.first).to_be_hidden()
    expect(lab.page.locator("ft-faults .then")).to_be_hidden()


def test_another_experiment_opens_with_its_first_chart(lab: Lab) -> None:
    lab.without_scene()
    lab.fly_until(5.0)
    scroller = lab.page.locator("ft-charts .scroller")
    scroller.evaluate("e => { e.scrollTop = 300; }")
    assert scroller.evaluate("e => e.scrollTop") > 0
    lab.page.get_by_role("button", name="Branch from here").first.click()
    expect(lab.page.locator("ft-topbar .branches option:checked")).to_contain_text("Branch")
    assert scroller.evaluate("e => e.scrollTop") == 0


FARTHER = """(level) => import('/static/session.js').then(({ recording, recorded }) => {
  const column = recording.column(level);
  for (let i = 0; i < column.length; i += 1) column[i] *= 100;
  recorded.dispatchEvent(new CustomEvent('change'));
})"""


def test_a_limit_far_away_does_not_flatten_the_lines(lab: Lab) -> None:
    lab.without_scene()
    lab.page.get_by_label("Scenario").select_option("chey-2004")
    expect(lab.page.locator("ft-moment")).to_have_count(3)
    chart = lab.page.locator("ft-chart").filter(has=lab.page.locator("h3", has_text="Horizontal error"))
    limit = chart.locator(".legend .line", has_text="alert limit").locator(".value")
    top = "e => e.querySelector('.plot')._fullLayout.yaxis.range[1]"
    lab.fly_until(20.0)
    expect(limit).to_have_text("120.0")
    assert chart.evaluate(top) > 120.0
    lab.page.evaluate(FARTHER, "protection.alert")
    expect(limit).to_have_text("12000.0 ↑")
    assert chart.evaluate(top) < 120.0
