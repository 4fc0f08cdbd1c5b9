"""Data of the page: mirror and its age, deltas, description and metrics."""

from __future__ import annotations

import copy
import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client.parser import text_string_to_metric_families

from controller.core.clock import MonotonicClock
from controller.core.devices import Memory
from controller.core.expr import leaves
from controller.events.kinds import as_record
from controller.history.query import RowSelection, open_history
from controller.history.summary import summary
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.panel.modbus import mirror
from controller.hmi.panel.modbus.mirror import STALE_MS, blocks
from controller.hmi.panel.modbus.telemetry import TagFileError, Telemetry, load_tags
from controller.hmi.panel.view.describe import describe
from controller.hmi.panel.view.state import delta
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.operator.next_press import NextPress
from controller.program.states import State
from controller.program.tags import ROWS, SIDES
from controller.program.texts.next_press import NEXT_PRESSES
from plant_sim.faults import parse_fault
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.ending.reported import ReportedEvents
from plant_sim.twin.recovery import home_again, repair
from tests.controller.history.history_rig import history
from tests.controller.hmi.panel.panel_rig import PanelRig, apply
from tests.controller.hmi.panel.test_chinese import MACHINE, view_builder
from tests.plant_sim.twin.twin_rig import TRAY_MS, at_work, to_complete

VALUES = st.none() | st.booleans() | st.integers(0, 5) | st.lists(st.integers(0, 2), max_size=2)
STEPS = st.dictionaries(st.sampled_from(["S20", "S21", "S22"]), st.just(1))
VIEWS = st.fixed_dictionaries(
    {
        "steps": STEPS,
        "forced": st.lists(st.sampled_from(["X0", "X5"]), max_size=2),
        "machine": st.fixed_dictionaries({"state": VALUES, "refusal": VALUES}),
        "arms": st.fixed_dictionaries({"left": st.fixed_dictionaries({"down": VALUES})}),
    }
)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelRig]:
    """Yield a machine 0.5 s before the end of its first complete cycle, which would take 17 s in real time."""
    twin = at_work()
    for step in ("lift from row", "release delay"):
        bits = [twin.step_of(f"{side} arm", step) for side in SIDES]
        twin.run_until(bits[0] | bits[1], within_ms=30_000)
    with PanelRig(tmp_path_factory.mktemp("panel"), twin) as rig:
        yield rig


@given(st.lists(VIEWS, min_size=1, max_size=6))
def test_successive_deltas_reproduce_the_view(views: list[dict[str, Any]]) -> None:
    shown = copy.deepcopy(views[0])
    for before, after in itertools.pairwise(views):
        changes = delta(before, after)
        apply(shown, json.loads(json.dumps(changes)))
        assert shown == after
        assert (changes == {}) == (before == after)


POLLED = {
    ("C" if block.kind == "CN" else block.kind, number)
    for block in blocks(MACHINE.io_map)
    for number in range(block.first, block.first + block.count)
}
"""Devices that are read from the controller."""


def test_every_condition_of_a_command_is_polled() -> None:
    for command in MACHINE.tags.commands:
        for obstacle in MACHINE.orders.obstacles(command.bit):
            assert {(leaf.kind, leaf.number) for leaf in leaves(obstacle.active)} <= POLLED, command.name


def test_every_word_of_the_view_is_polled(monkeypatch: pytest.MonkeyPatch) -> None:
    builder, _ = view_builder()
    read = set()
    word = Memory.word

    def recorded(memory: Memory, kind: str, number: int) -> int:
        read.add((kind, number))
        return word(memory, kind, number)

    monkeypatch.setattr(Memory, "word", recorded)
    builder.view()
    frequency = MACHINE.tags.planting.frequency
    assert (frequency.kind, frequency.number) in read
    assert read - POLLED == set()


def test_view_matches_the_controller(rig: PanelRig) -> None:
    twin = rig.twin
    with rig.browser() as browser:
        view = browser.until(lambda view: view["machine"]["state"] == State.EXECUTE)
        assert {f"S{s}" for s in range(1_000)} >= set(view["steps"])
        assert view["arms"]["left"]["step"] in view["steps"]
        assert set(view["io"]) == {p.address for p in (*twin.io_map.inputs, *twin.io_map.outputs)}
        assert view["io"]["X24"] == view["io"]["X25"] == 1  # normally closed, not pressed
        assert view["set_points"]["clamp"] == twin.plc.read(twin.machine.tags.sp.clamp)
        moved = browser.until(lambda view: view["arms"]["left"]["cycles"] + view["arms"]["right"]["cycles"] > 0)
        assert moved["machine"]["time_ms"] > 0
        side = "left" if moved["arms"]["left"]["cycles"] else "right"
        assert moved["arms"][side]["rows"]["1"] in (0, 1, 2, 3)
        assert not moved["commands"]["reset"]["free"]
        assert moved["commands"]["hold"] == {"free": True, "why": None}


def test_panel_console_and_history_count_the_same_rows(tmp_path: Path) -> None:
    """A row whose cycle a jam interrupts after the release counts, although its cycle is not timed."""
    twin, path = at_work({"trays_target": 1}), tmp_path / "history.sqlite"
    twin.run_until(twin.machine.tags.arms["left"].cycles.equals(1), within_ms=TRAY_MS)
    jam = parse_fault("jammed:left.lift")
    twin.plant.faults.add(jam)
    twin.run_until_state(State.HELD, within_ms=TRAY_MS)
    repair(twin, jam)
    home_again(twin)
    twin.start()
    to_complete(twin)
    builder, mirror = view_builder()
    console = ReportedEvents()
    with history(path) as writer:
        for event in twin.events:
            console.apply(as_record(event))
            writer.write(event)
    with open_history(path) as db:
        (day,) = summary(db, RowSelection())
    for kind, number in POLLED:
        if kind in "DC":
            mirror.memory.set_word(kind, number, twin.plc.memory.word(kind, number))
    arms = builder.view()["arms"]
    assert day.timed < day.rows
    assert {arms["left"]["cycles"] + arms["right"]["cycles"], console.rows, day.rows} == {len(ROWS) * len(SIDES)}


def test_what_to_do_now_does_not_repeat_the_alarm_of_the_banner() -> None:
    builder, mirror = view_builder()
    machine = MACHINE.tags.machine
    alarm = next(alarm for alarm in MACHINE.alarms if alarm.stops_work)
    mirror.memory.D[machine.next_press.number] = NextPress.REPAIR_AND_HOME
    mirror.memory.D[machine.first_out.number] = alarm.bit.number
    line = NEXT_PRESSES[NextPress.REPAIR_AND_HOME]
    control = builder.view()["machine"]
    assert control["next"] == {"en": line.en, "zh": line.zh}
    assert control["isolate"]
    assert control["next_command"] == "reset"


def test_deltas_of_a_running_machine_reproduce_the_view(rig: PanelRig) -> None:
    with rig.browser() as browser:
        for _ in range(10):
            browser.read()
        with rig.browser() as fresh:
            browser.until(lambda view: view["machine"]["time_ms"] >= fresh.view["machine"]["time_ms"])
            fresh.until(lambda view: view["machine"]["time_ms"] >= browser.view["machine"]["time_ms"])
            browser.until(lambda view: view["machine"]["time_ms"] >= fresh.view["machine"]["time_ms"])
            assert set(browser.view) == set(fresh.view)
            assert all(set(browser.view[s]) == set(fresh.view[s]) for s in browser.view if s not in ("steps", "forced"))
            if browser.view["machine"]["time_ms"] == fresh.view["machine"]["time_ms"]:
                assert browser.view["io"] == fresh.view["io"]


def test_view_ages_without_the_controller_and_recovers_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with PanelRig(tmp_path) as rig, rig.browser() as browser, monkeypatch.context() as patch:
        patch.setattr(mirror, "STALE_MS", STALE_MS)
        rig.stop_server()
        browser.until(lambda view: not view["link"]["controller"])
        old = browser.until(lambda view: view["link"]["age_ms"] > STALE_MS)
        assert old["machine"]["state"] == State.STOPPED  # last known state
        assert "transplanter_controller_up 0.0" in rig.here.get("/metrics").text
        assert "transplanter_scans_total" not in rig.here.get("/metrics").text
        rig.restart_server()
        browser.until(lambda view: bool(view["link"]["controller"]) and view["link"]["age_ms"] < 500)


def test_metrics_are_valid_prometheus_text(rig: PanelRig) -> None:
    with rig.browser():
        text = rig.here.get("/metrics").text
    families = {family.name: family for family in text_string_to_metric_families(text)}
    assert families["transplanter_controller_up"].samples[0].value == 1
    assert families["transplanter_panel_clients"].samples[0].value == 1
    assert families["transplanter_scans"].samples[0].value > 0
    assert families["transplanter_state"].samples[0].value == State.EXECUTE
    histogram = families["transplanter_scan_duration_seconds"]
    buckets = [sample.value for sample in histogram.samples if sample.name.endswith("_bucket")]
    assert len(buckets) == 14
    assert buckets == sorted(buckets)


def test_histogram_buckets_are_cumulative(tmp_path: Path) -> None:
    rig = PanelRig(tmp_path)
    for us in (50, 150, 150, 900_000):
        rig.hmi.figures.durations.add(us)
    with rig, rig.browser():
        text = rig.here.get("/metrics").text
    name = "transplanter_scan_duration_seconds"
    assert f'{name}_bucket{{le="0.0001"}} 1.0' in text
    assert f'{name}_bucket{{le="0.0002"}} 3.0' in text
    assert f'{name}_bucket{{le="+Inf"}} 4.0' in text
    assert f"{name}_sum 0.90035" in text


def test_description_is_complete() -> None:
    machine = build(load_io_map(DEFAULT_IO_MAP))
    description = json.loads(json.dumps(describe(machine, None)))
    assert [each["name"] for each in description["commands"]] == [command.name for command in machine.tags.commands]
    units = {each["name"]: (each["scale"], each["unit"]) for each in description["set_points"]}
    assert units["clamp"] == (10, "ms")
    assert units["ground_pulse"] == (1, "mm")
    assert units["planter_speed"] == (1, "mm/s")
    assert units["lambda_lowest"] == (0.01, "")
    assert units["trays_target"] == (1, "")
    assert [each["output"] for each in description["jogs"]] == list(machine.tags.commands.jog)
    names = {each["name"] for each in description["commands"]}
    assert {answer["command"] for question in description["questions"] for answer in question["answers"]} <= names
    for sequence in description["sequences"]:
        addresses = {step["s"] for step in sequence["steps"]}
        assert {go["to"] for step in sequence["steps"] for go in step["goes"]} <= addresses
    labelled = [
        *description["commands"],
        *description["set_points"],
        *description["jogs"],
        *description["questions"],
        *description["alarms"],
    ]
    assert all(each["text"]["en"] and each["text"]["zh"] for each in labelled)


def test_missing_history_is_reported(rig: PanelRig) -> None:
    assert rig.here.get("/api/history/events").status_code == 404
    assert rig.here.get("/api/history/last_cycle?side=left").status_code == 404
    assert rig.here.get("/api/history/records").status_code == 404
    for wrong in (
        "/api/history/none",
        "/api/history/events?last=x",
        "/api/history/events?before=-1",
        *(f"/api/history/records?{name}=x" for name in ("last", "before", "since", "until", "number")),
        f"/api/history/records?text={'x' * 101}",
        "/api/history/last_cycle",
        "/api/history/last_cycle?side=up",
    ):
        assert rig.here.get(wrong).status_code == 400, wrong


HEADING = "name,table,address,words,scale,signed,none,writable,meaning\n"
LIMITED = "name,table,address,low,high\n"
TAGS = HEADING + (
    "left.slide_mm,input,12,1,0.1,1,0,0,slide\n"
    "total,input,9,1,1,0,0,0,seedlings\n"
    "last_write_ms,input,22,2,1,0,1,0,last write\n"
    f"box.start,coil,{100},1,1,0,0,1,start\n"
    f"box.emergency_stop,coil,{102},1,1,0,0,1,emergency stop\n"
)


def test_telemetry_is_shown_and_the_box_can_be_operated(tmp_path: Path) -> None:
    file = tmp_path / "tags.csv"
    file.write_text(TAGS)
    io_map, parameters = load_io_map(DEFAULT_IO_MAP), load_machine()
    plant = Plant(io_map, parameters, seed=1)
    with ServerThread(PlantServer(IoModule(plant, io_map), port=0)) as served:
        port = served.server.port
        tags = load_tags(file)
        with (
            PanelRig(
                tmp_path, telemetry=lambda clock: Telemetry(ModbusConnection("127.0.0.1", port), tags, clock)
            ) as rig,
            rig.browser("operate") as browser,
        ):
            view = browser.until(lambda view: view["link"]["telemetry"] and view["telemetry"]["total"] is not None)
            assert view["telemetry"]["total"] == plant.counts().total
            assert view["telemetry"]["last_write_ms"] is None
            assert browser.order(type="box", button="start", pressed=True)["ok"] is True
            browser.until(lambda view: view["telemetry"]["box.start"] == 1)
            assert not browser.order(type="box", button="reset", pressed=True)["ok"]
        assert served.call(lambda: plant.box.start) is False  # released when its browser disconnects


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no tags"),
        (HEADING, "no tags"),
        (HEADING + "a,input,x,1,1,0,0,0,m\n", "tags.csv:2: address"),
        (HEADING + "a,none,1,1,1,0,0,0,m\n", "tags.csv:2: table"),
        (HEADING + "a,input,1,3,1,0,0,0,m\n", "tags.csv:2: words"),
        (HEADING + "a,input,1,1,1,0,0,0,m,more\n", "tags.csv:2: more cells"),
        ("name,table,address,colour\na,input,1,red\n", "tags.csv:2: colour: unknown column"),
        (LIMITED + "a,input,1,low,\n", "tags.csv:2: low"),
        ("name,table,address,words,word_order\na,input,1,2,low\n", "tags.csv:2: word_order"),
        (LIMITED + "a,input,1,,inf\n", "tags.csv:2: high"),
        (HEADING + 2 * "a,input,1,1,1,0,0,0,m\n", "duplicate tag a"),
    ],
)
def test_invalid_tag_file_is_reported_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "tags.csv"
    file.write_text(text)
    with pytest.raises(TagFileError) as raised:
        load_tags(file)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_source_without_response_has_no_values(tmp_path: Path) -> None:
    file = tmp_path / "tags.csv"
    file.write_text(TAGS)
    telemetry = Telemetry(ModbusConnection("127.0.0.1", 1), load_tags(file), MonotonicClock())
    assert set(telemetry.values.values()) == {None}
    assert telemetry.age_ms is None
