"""Cycle edges: completeness, exact times, assignment to cycles, and the history of a trial."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from controller.core.scan import Plc
from controller.events.alarm_list import AlarmList
from controller.events.cycle_edges import MAX_EDGES, CycleEdges, Edge
from controller.events.kinds import CycleEvent
from controller.events.production import ProductionLog
from controller.history.writer import HistoryWriter
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.tags import SIDES, Side
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import home_again
from tests.controller.history.history_rig import history, table
from tests.plant_sim.twin.twin_rig import ChangeRecorder, at_work, to_complete, until_picking, until_step


class Recorded(NamedTuple):
    """Trial of one tray, its history, and an independent record of outputs and steps."""

    path: Path
    twin: Twin
    cycles: list[CycleEvent]
    outputs: ChangeRecorder
    steps: ChangeRecorder


@contextmanager
def recorded(twin: Twin, path: Path) -> Iterator[HistoryWriter]:
    """Connect a history to a twin as the controller does: the edge recorder before the production log."""
    edges = CycleEdges(twin.machine)
    with history(path, edges_of=edges.of) as writer:
        first_out = twin.machine.tags.machine.first_out
        log = ProductionLog(twin.machine, writer.write)
        twin.runtime.observers += [edges, log, AlarmList(twin.machine.alarms, first_out, writer.write)]
        yield writer


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Return a trial of one tray with its history."""
    path = tmp_path_factory.mktemp("trial") / "history.sqlite"
    twin = at_work({"trays_target": 1}, trays=1)
    outputs, steps = ChangeRecorder.of_outputs(twin), ChangeRecorder.of_steps(twin)
    with recorded(twin, path):
        to_complete(twin)
    return Recorded(path, twin, twin.cycles(), outputs, steps)


def cycle_of(trial: Recorded, side: Side, row: int) -> tuple[CycleEvent, list[Edge]]:
    """Return a cycle of the trial and its edges in the history."""
    event = next(cycle for cycle in trial.cycles if (cycle.side, cycle.row) == (side, row))
    (record,) = [each for each in table(trial.path, "cycles") if (each["side"], each["row"]) == (side, row)]
    return event, [(ms, device, level) for ms, device, level in json.loads(str(record["edges"]))]


def split(edges: list[Edge]) -> tuple[list[Edge], list[Edge]]:
    """Return the initial levels and the edges that follow them."""
    devices = {device for _, device, _ in edges}
    return edges[: len(devices)], edges[len(devices) :]


EVERY_CYCLE = [(side, row) for side in SIDES for row in (1, 2, 3)]


@pytest.mark.parametrize(("side", "row"), EVERY_CYCLE)
def test_a_cycle_has_every_edge_of_its_outputs_and_steps_with_the_exact_scan_time(
    trial: Recorded, side: Side, row: int
) -> None:
    event, edges = cycle_of(trial, side, row)
    began_ms = event.at_ms - event.cycle_ms
    _, changes = split(edges)
    address = {point.tag.removeprefix(f"{side}."): point.address for point in trial.twin.io_map.outputs}
    outputs = {
        (change.at_ms - began_ms, address[change.name], int(change.on))
        for change in trial.outputs.of(f"{side}.", began_ms, event.at_ms)
    }
    titles = {title: str(bit) for title, bit in trial.twin.machine.cycles[side].bits.items()}
    steps = {
        (change.at_ms - began_ms, titles[change.name], int(change.on))
        for change in trial.steps.of(f"{side} arm: ", began_ms, event.at_ms)
    }
    assert len(outputs) >= 12
    assert {edge for edge in changes if edge[1].startswith("Y")} == outputs
    assert {edge for edge in changes if edge[1].startswith("S")} == steps


@pytest.mark.parametrize(("side", "row"), EVERY_CYCLE)
def test_edges_are_ordered_within_their_cycle_and_alternate_from_the_initial_levels(
    trial: Recorded, side: Side, row: int
) -> None:
    event, edges = cycle_of(trial, side, row)
    initial, changes = split(edges)
    levels = {device: level for _, device, level in initial}
    assert len(levels) == len(initial)
    assert {at_ms for at_ms, _, _ in initial} == {0}
    times = [at_ms for at_ms, _, _ in changes]
    assert times == sorted(times)
    assert (times[0], times[-1]) == (0, event.cycle_ms)
    for _, device, level in changes:
        assert levels[device] == 1 - level, "an edge must change the level"
        levels[device] = level


def test_the_coils_of_a_cycle_are_set_in_the_order_of_the_paper(trial: Recorded) -> None:
    _, edges = cycle_of(trial, "left", 3)
    initial, changes = split(edges)
    on = [device for _, device, level in changes if level and device.startswith("Y")]
    # in, close, up, out, spread, down, open, converge
    assert on == ["Y5", "Y16", "Y2", "Y6", "Y12", "Y1", "Y15", "Y11"]
    assert [edge for edge in changes if edge[0] == 0] == [(0, "S20", 0), (0, "S21", 1), (0, "Y5", 1)]
    assert {device for _, device, _ in initial if device[0] in "XY"} == {
        "X1",
        "X2",
        "X5",
        "X6",
        "X7",
        "X10",
        "X16",
        "X17",
        "X22",
        "Y1",
        "Y2",
        "Y5",
        "Y6",
        "Y11",
        "Y12",
        "Y15",
        "Y16",
    }
    cups = [edge for edge in changes if edge[1] == "X22" and edge[2]]
    assert len(cups) >= 6
    at = {(device, level): at_ms for at_ms, device, level in changes}
    assert at["X10", 1] <= at["Y5", 0], "the switch of row 3 ends the inward motion"


def test_the_history_of_a_trial_contains_its_production(trial: Recorded) -> None:
    assert [(row["side"], row["row"], row["cycle_ms"]) for row in table(trial.path, "cycles")] == [
        (cycle.side, cycle.row, cycle.cycle_ms) for cycle in trial.cycles
    ]
    kinds = [row["kind"] for row in table(trial.path, "events")]
    assert kinds.count("tray") == 1
    assert {"state", "question"} <= set(kinds)


def test_an_aborted_cycle_leaves_no_edges(tmp_path: Path) -> None:
    """After an emergency stop, the edges of the aborted cycle are discarded; recording restarts with the next cycle."""
    path = tmp_path / "history.sqlite"
    twin = at_work({"trays_target": 1})
    with recorded(twin, path):
        until_picking(twin, "left", 1)
        until_step(twin, "left arm", "slide to feed")
        twin.press("emergency_stop")
        twin.run_for(500)
        twin.command("clear")
        twin.run_for(100)
        assert home_again(twin) == {"tray"}
        twin.start()
        to_complete(twin)
    rows = table(path, "cycles")
    assert [row["row"] for row in rows if row["side"] == "left"] == [2, 3]
    for row in rows:
        edges = json.loads(str(row["edges"]))
        assert edges[0][0] == 0
        assert edges[-1][0] == row["cycle_ms"]
    assert table(path, "alarms")


def test_a_cycle_whose_start_was_not_recorded_has_no_edges(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    twin.run_for(100)
    edges = CycleEdges(twin.machine)
    twin.runtime.observers.insert(0, edges)
    twin.run_until(lambda: any(cycle.side == "left" for cycle in twin.cycles()), within_ms=60_000)
    assert edges.of(twin.cycles()[-1]) == ()
    assert not path.exists()


class Scans:
    """PLC memory that the test sets and the recorder evaluates every 10 ms."""

    def __init__(self) -> None:
        machine = build(load_io_map(DEFAULT_IO_MAP))
        self.cycle = machine.cycles["left"]
        self.edges = CycleEdges(machine)
        self.now_ms = 0
        self._plc = Plc(machine.program)
        self.scan(on=["wait at feed"])

    def scan(self, *, on: Sequence[str] = (), off: Sequence[str] = (), toggled: Sequence[int] = ()) -> None:
        """Set and reset steps, toggle inputs, and evaluate the memory."""
        memory = self._plc.memory
        for titles, level in ((off, False), (on, True)):
            for title in titles:
                memory.S[self.cycle[title].number] = level
        for number in toggled:
            memory.X[number] = not memory.X[number]
        self.now_ms += 10
        self.edges(self.now_ms, self._plc)

    def of(self, cycle_ms: int, side: Side = "left") -> tuple[Edge, ...]:
        """Return the edges of a cycle that ends in this scan."""
        return self.edges.of(CycleEvent(self.now_ms, side, 1, cycle_ms, 0, 0))


def test_the_number_of_edges_of_a_bouncing_switch_is_limited() -> None:
    scans = Scans()
    scans.scan(on=["approach row"], off=["wait at feed"])
    for _ in range(MAX_EDGES):
        scans.scan(toggled=[1, 2, 5, 6, 7])
    assert len(scans.of(10 * MAX_EDGES)) == MAX_EDGES


def test_edges_belong_to_one_cycle_and_end_with_it() -> None:
    scans = Scans()
    scans.scan(on=["approach row"], off=["wait at feed"])
    scans.scan(toggled=[1])
    scans.scan(on=["wait at feed"], off=["approach row"])
    ended = scans.of(20)
    assert [edge for edge in ended if edge[0]] == [(10, "X1", 1), (20, "S20", 1), (20, "S21", 0)]
    assert (scans.of(10), scans.of(30), scans.of(20, "right")) == ((), (), ())
    scans.scan(toggled=[1])
    assert scans.of(30) == ended, "edges between two cycles belong to neither"
    scans.scan(on=["approach row"], off=["wait at feed"])
    assert [edge for edge in scans.of(0) if edge[1] in {"X1", "S20"}] == [(0, "X1", 0), (0, "S20", 1), (0, "S20", 0)]
    assert scans.of(40) == ()
