"""Trends page in a browser in Shanghai: clock, zoom, fingers, limits, gaps and readings; read from the charts' data."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from datetime import datetime
from itertools import accumulate
from pathlib import Path
from typing import Any, Final, NamedTuple
from zoneinfo import ZoneInfo

import pytest
from playwright.sync_api import Browser, Locator, Response, expect

from controller.core.clock import utc_ms
from controller.events.kinds import CycleEvent
from controller.history.writer import HistoryWriter
from controller.hmi.panel.view.texts import TEXTS
from controller.hmi.panel.view.trend_file import TrendFile
from controller.hmi.panel.view.trend_periods import Spread, TrendPeriod
from controller.hmi.panel.view.trends import MOST_PERIODS, PERIOD_MS
from controller.program.tags import Side
from tests.controller.common.modbus_rig import MACHINE
from tests.controller.hmi.panel.page.panel_page_rig import LiveMachine, PanelProcess
from tests.controller.hmi.panel.page.screen import Screen, chromium, press_unavailable

pytestmark = pytest.mark.nightly

ZONE: Final = "Asia/Shanghai"
HOUR_MS: Final = 3_600_000
RECORDED_MS: Final = 12 * HOUR_MS
DIP_MS: Final = 2 * HOUR_MS
"""Time of the pressure dip before the start of the panel, ms."""
STANDSTILL_MS: Final = 4 * HOUR_MS
"""Time before the start of the panel at which half an hour without a panel begins, ms."""
NAMES: Final = ("main_pressure_kpa", "claw_pressure_kpa", "left.clamp_n", "right.clamp_n")
LOW: Final = 251.0

PLOTS: Final = """async () => {
  const uPlot = (await import("/static/foreign/uPlot.esm.js")).default;
  return uPlot.sync("trends").plots.map((plot) => ({
    data: plot.data.map((column) => [...column]),
    range: [plot.scales.x.min, plot.scales.x.max],
    clock: plot.axes[0]._values,
    splits: plot.axes[0]._splits,
    looks: plot.series.slice(1).map((one) => `${one.dash ?? ""} ${one.points.fill(plot, 1) === "transparent"}`),
    colours: plot.series.slice(1).map((one) => one._stroke),
  }));
}"""
"""Script that returns data, range, clock axis and looks of all charts; the first one has the pressures."""


class Plot(NamedTuple):
    """Chart of the page; columns 1 to 3 of the data are the first series (lowest, highest, mean)."""

    data: list[list[float | None]]
    range: list[float]
    clock: list[str]
    splits: list[float]
    looks: list[str]
    colours: list[str]


class Trends:
    """Trends page of a panel that has recorded for half a day."""

    def __init__(self, screen: Screen, started_ms: int) -> None:
        self.screen = screen
        self.page = screen.page
        self.started_ms = started_ms

    def answer(self, act: Callable[[], object], where: Callable[[str], bool] = lambda _: True) -> dict[str, Any]:
        """Act, and return the next answer of the panel, once it is shown."""

        def wanted(response: Response) -> bool:
            return "/api/trends?" in response.url and where(response.url)

        with self.page.expect_response(wanted) as response:
            act()
        answer: dict[str, Any] = response.value.json()
        self.page.wait_for_function(SHOWN, arg=answer["to_ms"])
        return answer

    def span(self, minutes: int) -> dict[str, Any]:
        """Press the button of a span."""
        button = self.screen.find(f"[data-span='{minutes}']")
        return self.answer(button.click, lambda url: f"span={60_000 * minutes}&" in url)

    def press(self, name: str, where: Callable[[str], bool]) -> dict[str, Any]:
        """Press a button by its name."""
        return self.answer(self.screen.find(f"[data-trend='{name}']").click, where)

    def plots(self) -> list[Plot]:
        return [Plot(**plot) for plot in self.page.evaluate(PLOTS)]

    def pressures(self) -> Plot:
        return self.plots()[0]

    def area(self) -> tuple[float, float, float, float]:
        """Return left, top, width and height of the plotting area of the pressures, px."""
        box = self.screen.find(".u-over").first.bounding_box()
        assert box is not None
        return box["x"], box["y"], box["width"], box["height"]

    def point(self, share: float) -> None:
        left, top, width, height = self.area()
        self.page.mouse.move(left + share * width, top + height / 2)

    def drag(self, start: float, end: float) -> None:
        self.point(start)
        self.page.mouse.down()
        self.point((start + end) / 2)
        self.point(end)
        self.page.mouse.up()

    def touch(self, *places: tuple[float, ...]) -> None:
        """Put fingers on the pressures, move them from place to place, and lift them; shares of the width."""
        left, top, width, height = self.area()
        session = self.page.context.new_cdp_session(self.page)
        for n, shares in enumerate(places):
            points = [{"x": left + share * width, "y": top + height / 2, "id": id_} for id_, share in enumerate(shares)]
            kind = "touchMove" if n else "touchStart"
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        session.detach()

    @property
    def reading(self) -> Locator:
        return self.screen.find(".chart-reading").first


SHOWN: Final = """async (to) => {
  const uPlot = (await import("/static/foreign/uPlot.esm.js")).default;
  return uPlot.sync("trends").plots.every((plot) => plot.scales.x.max >= to);
}"""
"""Script that returns whether the charts show a range that ends at or after a time."""


def record(folder: Path, now_ms: int) -> None:
    """Write the trends of half a day, with a dip and half an hour without a panel, and its cycles."""
    standstill = range(now_ms - STANDSTILL_MS, now_ms - STANDSTILL_MS + HOUR_MS // 2)
    rows = []
    for at_ms in range(now_ms - RECORDED_MS, now_ms - PERIOD_MS, PERIOD_MS):
        dip = abs(at_ms - (now_ms - DIP_MS)) < PERIOD_MS
        main = Spread(LOW if dip else 395.0, 399.0, 404.0)
        values = (main, Spread(396.0, 398.0, 400.0), Spread(-2.0, 3.0, 8.0), Spread(-2.0, 3.0, 8.0))
        if at_ms not in standstill:
            rows.append(TrendPeriod(at_ms, PERIOD_MS, values))
    file = TrendFile(folder / "trends.sqlite", MOST_PERIODS)
    assert file.append(NAMES, rows)
    file.close()


def record_cycles(folder: Path, now_ms: int) -> None:
    """Write a cycle of each arm per minute of the last three hours into a history."""
    ends = range(now_ms - 3 * HOUR_MS, now_ms, 30_000)
    times = iter([ends.start, *ends])
    history = HistoryWriter(folder / "history.sqlite", wall_ms=lambda: next(times), program="transplanter", version="0")
    for n in range(len(ends)):
        side: Side = "right" if n % 2 else "left"
        history.write(CycleEvent(0, side, 1, 7_800, 510, 0))
    history.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium({**os.environ, "TZ": ZONE}) as process:
        yield process


@pytest.fixture(scope="module")
def panel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[PanelProcess, int]]:
    folder = tmp_path_factory.mktemp("trends")
    own = folder / "panel"
    own.mkdir()
    now_ms = utc_ms()
    record(own, now_ms)
    record_cycles(own, now_ms)
    with LiveMachine(folder) as live, PanelProcess(live, own) as process:
        yield process, now_ms


@pytest.fixture(scope="module")
def shared(panel: tuple[PanelProcess, int], browser: Browser) -> Iterator[Trends]:
    process, now_ms = panel
    with Screen(browser, process.url) as screen:
        yield Trends(screen, now_ms)


@pytest.fixture
def trends(shared: Trends) -> Trends:
    """Return the page as it opens: live, ten minutes."""
    shared.screen.open("overview")
    shared.answer(lambda: shared.screen.open("trends"))
    return shared


def known(column: list[float | None]) -> list[float]:
    return [value for value in column if value is not None]


def test_the_axis_shows_the_clock_of_the_operator(trends: Trends) -> None:
    trends.span(60)
    for plot in trends.plots():
        local = [datetime.fromtimestamp(at / 1000, ZoneInfo(ZONE)) for at in plot.splits]
        assert len(local) >= 3
        shown = [at.strftime("%d/%m" if (at.hour, at.minute) == (0, 0) else "%H:%M") for at in local]
        assert plot.clock == shown
    expect(trends.screen.find("[data-part=trend-range]")).to_contain_text(
        re.compile(r"\d\d:\d\d:\d\d \+08:00 to \d\d:\d\d:\d\d \+08:00")
    )


@pytest.mark.parametrize(
    ("zone", "before", "shown"),
    [
        ("Europe/Berlin", "2026-10-25T00:30Z", ["25/10/2026, 02:30:00 +02:00", "25/10/2026, 02:30:00 +01:00"]),
        ("Europe/Berlin", "2026-03-29T00:30Z", ["29/03/2026, 01:30:00 +01:00", "29/03/2026, 03:30:00 +02:00"]),
        ("America/St_Johns", "2026-01-01T03:30Z", ["01/01/2026, 00:00:00 -03:30", "01/01/2026, 01:00:00 -03:30"]),
    ],
)
def test_two_times_an_hour_apart_differ_on_the_page(trends: Trends, zone: str, before: str, shown: list[str]) -> None:
    browser = trends.page.context.new_cdp_session(trends.page)
    browser.send("Emulation.setTimezoneOverride", {"timezoneId": zone})
    try:
        times = trends.page.evaluate(
            "async (at) => [0, 3600000].map(((texts) => (ms) => texts.wallClock(Date.parse(at) + ms))"
            "(await import('/static/texts.js')))",
            before,
        )
    finally:
        browser.send("Emulation.setTimezoneOverride", {"timezoneId": ""})
        browser.detach()
    assert times == shown


def test_half_a_day_has_the_dip_and_the_standstill(trends: Trends) -> None:
    answer = trends.span(720)
    assert answer["to_ms"] - answer["from_ms"] == RECORDED_MS
    low, _, mean = trends.pressures().data[1:4]
    times = trends.pressures().data[0]
    assert min(known(low)) == LOW
    assert abs((times[low.index(LOW)] or 0) - (trends.started_ms - DIP_MS)) <= answer["step_ms"]
    gap = next(n for n, value in enumerate(mean) if value is None and n > 0)
    before, after = times[gap - 1], times[gap + 1]
    assert before is not None
    assert after is not None
    assert abs(after - before - HOUR_MS / 2) <= 2 * answer["step_ms"]


def test_a_drag_shows_its_times_with_finer_points(trends: Trends) -> None:
    coarse = trends.span(720)
    shares = [1 - (DIP_MS + HOUR_MS / 2) / RECORDED_MS, 1 - (DIP_MS - HOUR_MS / 2) / RECORDED_MS]
    fine = trends.answer(lambda: trends.drag(*shares), lambda url: "end=" in url)
    assert fine["step_ms"] < coarse["step_ms"] / 8
    assert fine["to_ms"] - fine["from_ms"] == pytest.approx(HOUR_MS, rel=0.05)
    assert abs((fine["from_ms"] + fine["to_ms"]) / 2 - (trends.started_ms - DIP_MS)) < HOUR_MS / 10
    for plot in trends.plots():
        assert plot.range == [fine["from_ms"], fine["to_ms"]]
    assert LOW in trends.pressures().data[1]


def test_the_buttons_zoom_pan_and_go_back_to_live(trends: Trends) -> None:
    live = trends.screen.find("[data-trend=live]")
    expect(live).to_have_attribute("aria-pressed", "true")
    half = trends.press("in", lambda url: "span=300000" in url)
    assert half["to_ms"] == half["now_ms"], "a live range stays live"
    earlier = trends.press("earlier", lambda url: "end=" in url)
    assert half["to_ms"] - 160_000 < earlier["to_ms"] <= earlier["now_ms"] - 149_000
    expect(live).to_have_attribute("aria-pressed", "false")
    out = trends.press("out", lambda url: "span=600000" in url)
    assert out["to_ms"] == out["now_ms"], "a range that would end in the future is live"
    trends.span(240)
    back = trends.press("earlier", lambda url: "end=" in url)
    again = trends.press("later", lambda url: "end=" not in url)
    assert again["to_ms"] - back["to_ms"] == pytest.approx(2 * HOUR_MS, abs=60_000)
    trends.press("earlier", lambda url: "end=" in url)
    trends.span(10)
    expect(live).to_have_attribute("aria-pressed", "false")
    trends.press("live", lambda url: "end=" not in url)
    expect(live).to_have_attribute("aria-pressed", "true")
    trends.answer(lambda: None)  # the live range is fetched again and again
    assert trends.pressures().range[1] > again["to_ms"]


def test_a_live_range_has_no_later_values(trends: Trends) -> None:
    later, notice = trends.screen.find("[data-trend=later]"), trends.screen.find("[data-part=notice]")
    press_unavailable(later)
    expect(notice).to_have_text(f"✕ {TEXTS['trends.latest'].en}")
    trends.press("earlier", lambda url: "end=" in url)
    expect(later).not_to_have_attribute("aria-disabled", "true")
    expect(notice).to_be_empty()


def test_the_axis_shows_the_present_before_the_first_answer(trends: Trends) -> None:
    end_ms = trends.page.evaluate("async () => new (await import('/static/pages/trend_range.js')).TrendRange().toMs")
    assert end_ms == pytest.approx(utc_ms(), abs=60_000)


def test_the_range_ends_where_the_records_end(trends: Trends) -> None:
    trends.span(720)
    for _ in range(3):
        oldest = trends.press("earlier", lambda url: "end=" in url)
    assert oldest["from_ms"] >= oldest["now_ms"] - oldest["kept_ms"]
    assert oldest["to_ms"] - oldest["from_ms"] == pytest.approx(RECORDED_MS, abs=5_000)
    widest = trends.press("out", lambda url: "end=" in url)
    assert widest["to_ms"] - widest["from_ms"] == pytest.approx(RECORDED_MS, abs=5_000)


def test_fingers_move_and_stretch_the_time(trends: Trends) -> None:
    trends.span(240)
    before = trends.pressures().range
    moved = trends.answer(lambda: trends.touch((0.3,), (0.4,), (0.55,)), lambda url: "end=" in url)
    trends.page.wait_for_function(SPAN, arg=[before[0] - HOUR_MS, 4 * HOUR_MS])
    assert moved["to_ms"] < moved["now_ms"]
    trends.answer(lambda: trends.touch((0.4, 0.6), (0.35, 0.65), (0.3, 0.7)), lambda url: "span=14400000" not in url)
    trends.page.wait_for_function(SPAN, arg=[before[0] - HOUR_MS + HOUR_MS, 2 * HOUR_MS])


SPAN: Final = """async ([from, span]) => {
  const uPlot = (await import("/static/foreign/uPlot.esm.js")).default;
  const near = (one, other) => Math.abs(one - other) < 300000;
  return uPlot.sync("trends").plots.every(({ scales: { x } }) => near(x.min, from) && near(x.max - x.min, span));
}"""
"""Script that returns whether the charts show a span from a time, to five minutes."""


def test_limits_are_those_of_the_machine_over_the_whole_range(trends: Trends) -> None:
    trends.span(60)
    supply = MACHINE.supply
    limits = [(supply.pressure_ok_pa - supply.pressure_ok_gap_pa) / 1e3, MACHINE.rating.claws_least_pa / 1e3]
    plot = trends.pressures()
    assert [set(column) for column in plot.data[7:]] == [{limit} for limit in limits]
    times = known(plot.data[0])
    assert times[0] <= plot.range[0]
    assert times[-1] >= plot.range[1]
    legend = trends.screen.find(".chart").first.locator(".limit")
    expect(legend).to_have_text(["main: lower limit 380.0 kPa", "claws: lower limit 100.0 kPa"])
    clamp = trends.screen.find("[data-chart='Clamp force'] .limit")
    expect(clamp).to_have_text([f"lower limit {MACHINE.claws.holds_above_n:.1f} N"])


def test_the_legend_of_a_limit_has_the_dashes_of_its_line(trends: Trends) -> None:
    trends.span(60)
    dashes = [int(length) for length in trends.pressures().looks[-1].partition(" ")[0].split(",")]
    legend = trends.screen.find(".chart .limit").first
    drawn = legend.evaluate("one => getComputedStyle(one, '::before').backgroundImage")
    ends = [int(end) for end in re.findall(r"\b([1-9]\d*)px", drawn)]
    assert ends == list(accumulate(dashes))


def test_series_differ_by_more_than_their_colour(trends: Trends) -> None:
    for plot in trends.plots():
        means = plot.looks[2:6:3]
        assert len(set(means)) == len(means)


def test_cycles_and_rows_of_the_history_are_drawn(trends: Trends) -> None:
    trends.span(240)
    cycle = trends.screen.find("[data-chart='Cycle times']")
    expect(cycle).to_be_visible()
    expect(cycle.locator(".trend-plot")).to_have_attribute(
        "aria-label", re.compile("left: lowest 7.80, highest 7.80, right: lowest 7.80, highest 7.80$")
    )
    rows = trends.screen.find("[data-chart='Rows per clock hour'] .trend-plot")
    expect(rows).to_have_attribute("aria-label", re.compile("left: lowest 0, highest 60, right: lowest 0, highest 60$"))


def test_the_reading_has_clock_values_and_unit_in_both_languages(trends: Trends) -> None:
    trends.span(720)
    trends.point(1 - 3 * HOUR_MS / RECORDED_MS)
    expect(trends.reading).to_have_text(
        re.compile(r"^\d\d:\d\d:\d\d: main 399\.0 \(395\.0 to 404\.0\), claws 398\.0 \(396\.0 to 400\.0\) kPa$")
    )
    other = trends.screen.find("[data-chart='Clamp force'] .chart-reading")
    expect(other).to_have_text(re.compile(r"^\d\d:\d\d:\d\d: left 3\.0 \(0\.0 to 8\.0\), right .* N$"))
    plot = trends.screen.find(".trend-plot").first
    expect(plot).to_have_attribute("aria-label", re.compile(r"^Pressures, kPa, .*main: lowest 251\.0, highest "))
    try:
        trends.answer(lambda: trends.screen.find("[data-action=language]").select_option("zh"))
        trends.span(720)
        trends.point(1 - 3 * HOUR_MS / RECORDED_MS)
        expect(trends.reading).to_have_text(
            re.compile(r"^\d\d:\d\d:\d\d：主气路 399\.0（395\.0 至 404\.0），夹爪 398\.0（396\.0 至 400\.0） kPa$")
        )
        expect(trends.screen.find("[data-trend=live]")).to_have_text(TEXTS["trends.live"].zh)
    finally:
        trends.screen.find("[data-action=language]").select_option("en")


def test_a_theme_recolours_the_open_charts(trends: Trends) -> None:
    theme = trends.screen.find("[data-action=theme]")
    seen = {}
    for name in ("day", "grey"):
        theme.select_option(name)
        trends.page.wait_for_function(COLOURED)
        seen[name] = trends.pressures().colours
    assert all(one != other for one, other in zip(*seen.values(), strict=True))


COLOURED: Final = """async () => {
  const uPlot = (await import("/static/foreign/uPlot.esm.js")).default;
  const colour = getComputedStyle(document.documentElement).getPropertyValue("--series-0");
  return uPlot.sync("trends").plots.every((plot) => plot.series[3]._stroke === colour);
}"""
"""Script that returns whether the charts are drawn in the colours of the theme."""


FITTED: Final = """() => [...document.querySelectorAll(".chart:not([hidden]) .trend-plot")].every(
  (plot) => plot.firstElementChild.clientWidth === plot.clientWidth)"""
"""Script that returns whether the charts are as wide as their places."""


@pytest.mark.parametrize(("width", "least"), [(360, 79), (1_023, 79), (1_024, 44)])
def test_buttons_are_large_on_a_small_screen(trends: Trends, width: int, least: int) -> None:
    trends.page.set_viewport_size({"width": width, "height": 800})
    try:
        boxes = [button.bounding_box() for button in trends.screen.find(".trend-orders button").all()]
        assert len(boxes) == 9
        assert all(box is not None and box["height"] >= least and box["width"] >= least for box in boxes)
        assert trends.page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
        trends.page.wait_for_function(FITTED)
    finally:
        trends.page.set_viewport_size({"width": 1_280, "height": 800})


def test_the_charts_are_removed_with_their_page(trends: Trends) -> None:
    trends.screen.open("overview")
    assert trends.plots() == []


def test_the_trends_survive_a_restart_of_the_panel(panel: tuple[PanelProcess, int], trends: Trends) -> None:
    process, _ = panel
    with process.restarted():
        pass
    answer = trends.page.request.get(f"{process.url}/api/trends?span={RECORDED_MS}&points=300").json()
    lows = answer["tables"][0]["series"]["main_pressure_kpa"]["low"]
    assert min(known(lows)) == LOW
    trends.screen.unexpected.clear()  # the page reports the lost connection
