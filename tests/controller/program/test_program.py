"""Program tables: steps, alarms, texts, commands, devices, states and optional points."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

from controller.common.modbus.io_map import IoMap, Point, Polarity
from controller.core.devices import timer_base_ms
from controller.core.expr import Bit, Word, any_of, leaves
from controller.core.rungs import Annunciate, OnDelay, Out
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.operator.start_warning import warning_ms
from controller.program.states import MOVING, State
from controller.program.tags import Tags
from controller.program.texts.alarms.messages import ALARMS
from controller.program.texts.operator import QUESTIONS, STATES, Text
from plant_sim.twin.lock_step import NotReachedError, Twin
from tests.plant_sim.twin.twin_rig import (
    ALARM,
    at_work,
    go_on,
    moving_outputs,
    switched_on,
    to_complete,
    undisturbed,
    until_picking,
    until_step,
)
from tests.wiring import YIELD, wired

MACHINE = build(load_io_map(DEFAULT_IO_MAP))
STEPS = [(sequence, bit, step) for sequence in MACHINE.program.sequences() for bit, step in sequence]
RETENTIVE_STEPS = range(500, 900)
RETENTIVE_TIMERS = range(246, 256)
OPTIONAL = (
    "reset",
    "air_pressure_ok",
    "magazine_empty",
    "ground_pulse",
    *YIELD,
    "guard",
    "horn",
    "lamp_red",
    "lamp_green",
    "planter_speed",
)


# steps and timers


def test_a_moving_step_has_a_limit_and_a_waiting_step_states_its_reason() -> None:
    for sequence, _, step in STEPS:
        where = f"{sequence.name}: {step.title}"
        if step.hold:
            assert step.watch or step.dwell, where
            assert not step.waits_for, where
        else:
            assert not step.watch, where
            assert bool(step.dwell) != bool(step.waits_for), where


def test_every_step_has_its_own_s_outside_the_retentive_range() -> None:
    numbers = [bit.number for _, bit, _ in STEPS]
    assert len(set(numbers)) == len(numbers)
    assert not set(numbers) & set(RETENTIVE_STEPS)


def test_an_arm_is_active_in_every_step_of_its_cycle() -> None:
    """Otherwise a hold or stop could take effect in the step that is missing, with the arm over the tray."""
    outs = {rung.target: rung for rung in MACHINE.program.rungs() if isinstance(rung, Out)}
    for side, cycle in MACHINE.cycles.items():
        when = outs[MACHINE.tags.arms[side].active].when
        assert when == any_of(*(bit for bit, _ in cycle))


def test_every_limit_has_its_own_alarm_and_timer() -> None:
    watches = [step.watch for _, _, step in STEPS if step.watch]
    assert len({watch.alarm for watch in watches}) == len(watches)
    assert len({watch.timer for watch in watches}) == len(watches)


def test_limits_leave_room_for_a_slow_motion_and_not_for_a_jam() -> None:
    """Each limit is 1.5 to 3.1 times the duration of its longest motion.

    Manual calculation: 378.5 mm at 142.6 mm/s for the widest row spacing, 150 mm and 187 mm at 200 mm/s, and the
    longest claw dwell that can be set.
    """
    longest_ms = {"slide": 2_720, "lift": 815, "spread": 985, "converge": 985, "claws": 2_000}
    for sequence, _, step in STEPS:
        if step.watch and sequence is not MACHINE.feeder:
            moves = step.hold[0].name.rpartition("want ")[2].partition("_")[0]
            assert 1.5 <= step.watch.ms / longest_ms[moves] <= 3.1, f"{sequence.name}: {step.title}"


def test_the_limit_of_a_leaving_tray_stops_the_next_one_before_its_first_row_has_passed() -> None:
    """The time limit for a leaving tray is between 1.1 times its travel time and 3.4 s.

    A tray of 540 mm leaves in 2.75 s at 200 mm/s. After 3.4 s the next tray, 45 mm behind it, has overrun by 100 mm.
    """
    watch = MACHINE.feeder.steps[1].watch
    assert watch is not None
    assert 1.1 * 2_750 <= watch.ms <= 3_400


def test_timers_are_plain_and_have_the_time_base_of_their_preset() -> None:
    """Names of set-points end in x10 ms for 10 ms timers and in x100 ms for 100 ms timers; no timer is retentive."""
    for rung in MACHINE.program.rungs():
        if isinstance(rung, OnDelay | Annunciate):
            assert rung.timer.number not in RETENTIVE_TIMERS, rung.timer
            if isinstance(rung.preset, Word):
                assert rung.preset.name.endswith(f" x{timer_base_ms(rung.timer.number)} ms"), rung


# devices


@cache
def devices() -> set[Bit | Word]:
    return set(MACHINE.program.devices())


def test_retentive_devices_are_in_the_fixed_latched_ranges() -> None:
    retentive = {str(device): device.number for device in MACHINE.program.retentive}
    assert retentive
    for name, number in retentive.items():
        assert name[0] in "MD", name
        assert number >= (1024 if name[0] == "M" else 512), name


def test_required_devices_are_retentive() -> None:
    retentive = set(MACHINE.program.retentive)
    tags = MACHINE.tags
    wanted: list[Bit | Word] = [
        tags.machine.mode,
        tags.tray.phase,
        tags.machine.trays_done,
        tags.machine.batch_complete,
        tags.machine.rows_left,
        tags.tray.exit_time,
    ]
    wanted += [word for word, _ in tags.sp.defaults if word not in tags.sp.constants]
    for arm in tags.arms.values():
        wanted += [arm.loaded, arm.claws_closed, arm.claws_known, arm.clamped, *arm.rows.values()]
        wanted += [arm.missed_cups, arm.cycles, arm.on_row, *arm.reached.values(), arm.out_of_service]
    assert retentive == set(wanted)


def named_devices(owner: object) -> list[Bit | Word]:
    """Return the devices among the attributes of an object, including those in dictionaries."""
    found: list[Bit | Word] = []
    for value in vars(owner).values():
        values = value.values() if isinstance(value, dict) else [value]
        found += [item for item in values if isinstance(item, Bit | Word)]
    return found


@pytest.mark.parametrize("owner", ["system", "machine", "tray", "left", "right"])
def test_no_tag_is_left_unused(owner: str) -> None:
    tags: Tags = MACHINE.tags
    group = getattr(tags, owner, None) or tags.arms["left" if owner == "left" else "right"]
    used = {*devices(), *build(wired("guard", "horn")).program.devices()}
    assert [str(device) + " " + device.name for device in named_devices(group) if device not in used] == []


def test_two_tags_never_share_a_device() -> None:
    tags = MACHINE.tags
    groups = [tags.system, tags.machine, tags.tray, *tags.arms.values(), tags.sp]
    found = [device for group in groups for device in named_devices(group)] + [c.bit for c in tags.commands]
    internal = [device for device in found if device.kind in "MD"]
    assert len(set(internal)) == len(internal) > 100


# texts


def is_translated(text: Text) -> bool:
    chinese = any("一" <= character <= "鿿" for character in text.zh)
    return bool(text.en) and text.en.isascii() and chinese and ("{side}" in text.en) == ("{side}" in text.zh)


@pytest.mark.parametrize("table", [ALARMS, STATES, QUESTIONS], ids=["alarms", "states", "questions"])
def test_every_text_exists_in_english_and_chinese(table: dict[object, Text]) -> None:
    assert [key for key, text in table.items() if not is_translated(text)] == []
    assert len({text.en for text in table.values()}) == len({text.zh for text in table.values()}) == len(table)


def test_every_state_has_a_text_and_every_alarm_text_has_an_alarm() -> None:
    assert {state.value for state in State} == set(STATES)
    assert {alarm.key for alarm in build(wired(*YIELD)).alarms} >= set(ALARMS)


def test_alarm_texts_are_distinct_and_name_their_side() -> None:
    alarms = list(MACHINE.alarms)
    assert len({alarm.text.en for alarm in alarms}) == len({alarm.text.zh for alarm in alarms}) == len(alarms)
    assert [alarm.bit.number for alarm in alarms] == sorted({alarm.bit.number for alarm in alarms})
    for alarm in alarms:
        assert (alarm.side is None) or alarm.side in alarm.text.en.lower()
        assert "{" not in alarm.text.en + alarm.text.zh
        assert MACHINE.alarms.of(alarm.bit.number) is alarm


# commands


def test_commands_are_unique_and_every_one_is_read() -> None:
    commands = list(MACHINE.tags.commands)
    assert len({command.name for command in commands}) == len({command.bit for command in commands}) == len(commands)
    read = {device for rung in MACHINE.program.rungs() for device in leaves(rung.when)}
    assert [command.name for command in commands if command.bit not in read] == []
    assert all(command.meaning for command in commands)


def test_a_command_bit_is_on_for_one_scan() -> None:
    twin = switched_on()
    for command in twin.machine.tags.commands:
        twin.command(command.name)
        assert twin.plc.read(command.bit) == 1
        twin.scan()
        assert twin.plc.read(command.bit) == 0, command.name


def test_an_unknown_command_is_reported_with_the_known_ones() -> None:
    with pytest.raises(KeyError, match="unknown command 'jump'; known: reset, start, stop"):
        MACHINE.tags.commands["jump"]


# states


def test_every_state_can_be_reached_and_left() -> None:
    reached = {State.STOPPED}
    while True:
        more = {row.target for row in MACHINE.states if reached & set(row.sources)} - reached
        if not more:
            break
        reached |= more
    assert reached == set(State)
    assert {source for row in MACHINE.states for source in row.sources} == set(State)
    assert all(row.reason and row.target not in row.sources for row in MACHINE.states)


def test_an_emergency_stop_leaves_every_state_that_can_move() -> None:
    aborting = next(row for row in MACHINE.states if row.target == State.ABORTING)
    assert set(aborting.sources) == set(State) - {State.ABORTING, State.ABORTED}
    assert MACHINE.states[-1] is aborting, "the last row has priority"
    assert set(MOVING) <= set(aborting.sources)


# optional points


SIGNALS = wired("reset", "air_pressure_ok", "magazine_empty", "horn", "lamp_red", "lamp_green")
"""Map without the points for which a twin runs in Python."""


@pytest.fixture(scope="module")
def all_wired(tmp_path_factory: pytest.TempPathFactory) -> IoMap:
    """Return the default map with every optional point wired."""
    path: Path = tmp_path_factory.mktemp("map") / "io_map.yaml"
    text = DEFAULT_IO_MAP.read_text(encoding="utf-8")
    assert text.count("wired: false") == len(OPTIONAL)
    path.write_text(text.replace("wired: false", "wired: true"), encoding="utf-8")
    return load_io_map(path)


def lamps(twin: Twin) -> set[str]:
    return {tag for tag, on in twin.plant.indicators.items() if on}


def test_unwired_optional_points_do_not_appear_in_the_program() -> None:
    assert not any(tag in MACHINE.io_map for tag in OPTIONAL)
    used = {(device.kind, device.number) for device in devices() if device.kind in "XY"}
    assert used == {(point.device, point.number) for point in (*MACHINE.io_map.inputs, *MACHINE.io_map.outputs)}


def test_a_trial_with_every_optional_point_wired(all_wired: IoMap) -> None:
    twin = at_work({"trays_target": 1}, io_map=all_wired)
    until_picking(twin, "left", 2)
    assert lamps(twin) == {"lamp_green"}
    assert to_complete(twin) == undisturbed()
    assert lamps(twin) == set()


def test_the_reset_button_homes_and_clears() -> None:
    twin = switched_on(io_map=SIGNALS)
    twin.press("reset")
    assert twin.run_until_state(State.RESETTING, within_ms=150 + warning_ms(twin.machine.tags)) > 100, (
        "homes before the release"
    )
    twin.run_until_state(State.IDLE, within_ms=20_000)
    twin.press("reset")
    with pytest.raises(NotReachedError):
        twin.run_until_state(State.STARTING, within_ms=1_000)
    twin.press("emergency_stop")
    twin.run_until_state(State.ABORTED, within_ms=50)
    twin.run_for(500)
    twin.press("reset")
    assert twin.run_until_state(State.STOPPED, within_ms=150) > 100, "clears before the release"


def test_low_air_holds_the_machine_after_half_a_second() -> None:
    twin = at_work({"trays_target": 1}, trays=2, io_map=SIGNALS)
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", "wait for cups")
    pressure_ok = twin.plant.supply.pressure_ok
    pressure_ok.stuck = False
    twin.run_for(300)
    pressure_ok.stuck = None
    twin.run_for(1_000)
    assert twin.alarm_events() == []
    pressure_ok.stuck = False
    assert 400 <= twin.run_until(ALARM, within_ms=1_000) - 20 <= 510
    twin.run_until_state(State.HOLDING, within_ms=50)
    assert lamps(twin) == {"lamp_red", "horn"}
    twin.run_until_state(State.HELD, within_ms=5_000)
    assert (twin.alarms(), lamps(twin)) == (["air_low"], {"lamp_red", "horn"})
    twin.command("acknowledge")
    twin.run_for(20)
    assert lamps(twin) == {"lamp_red"}
    pressure_ok.stuck = None
    go_on(twin)
    counts = to_complete(twin)
    assert (counts.in_tray, counts.in_claw) == (72, 0)


def test_an_empty_magazine_is_a_warning_and_work_continues() -> None:
    twin = switched_on({"trays_target": 2}, trays=2, io_map=SIGNALS)
    twin.home()
    twin.start()
    assert twin.alarms() == []
    twin.run_until(ALARM, within_ms=120_000)
    assert twin.alarms() == ["magazine_empty"]
    assert (twin.plant.conveyor.in_magazine, twin.state) == (0, State.EXECUTE)
    assert lamps(twin) == {"lamp_green"}, "no horn for a warning"
    assert to_complete(twin) == undisturbed(trays=2)
    twin.plant.conveyor.magazine_empty.stuck = False
    twin.run_for(30)
    assert twin.alarms() == []


def test_the_amber_lamp_blinks_once_a_second_while_homing() -> None:
    twin = switched_on(io_map=SIGNALS)
    twin.press("start")
    twin.run_until_state(State.RESETTING, within_ms=50 + warning_ms(twin.machine.tags))
    seen = []
    for _ in range(200):
        twin.scan()
        seen.append("lamp_amber" in lamps(twin))
    assert twin.state == State.RESETTING
    assert sum(one != two for one, two in pairwise(seen)) == 4
    assert 90 <= sum(seen) <= 110


def test_suspended_is_amber_and_not_green() -> None:
    twin = switched_on(trays=0, io_map=SIGNALS)
    twin.home()
    twin.start()
    twin.run_until_state(State.SUSPENDED, within_ms=20_000)
    twin.run_for(50)
    seen = set()
    for _ in range(100):
        twin.scan()
        seen |= {frozenset(lamps(twin))}
    assert seen == {frozenset(), frozenset({"lamp_amber"})}


# polarity


def inverted(point: Point) -> Point:
    """Return a copy of a point with the opposite polarity."""
    opposite = {
        Polarity.NORMALLY_OPEN: Polarity.NORMALLY_CLOSED,
        Polarity.NORMALLY_CLOSED: Polarity.NORMALLY_OPEN,
        Polarity.ACTIVE_HIGH: Polarity.ACTIVE_LOW,
        Polarity.ACTIVE_LOW: Polarity.ACTIVE_HIGH,
    }
    return replace(point, polarity=opposite[point.polarity])


def test_a_trial_with_every_wire_inverted() -> None:
    io_map = load_io_map(DEFAULT_IO_MAP)
    io_map = replace(io_map, inputs=tuple(map(inverted, io_map.inputs)), outputs=tuple(map(inverted, io_map.outputs)))
    twin = at_work({"trays_target": 1}, io_map=io_map)
    assert to_complete(twin) == undisturbed()
    assert moving_outputs(twin) == set()
    rest = [point.number for point in io_map.outputs if point.moves]
    assert all(twin.runtime.released[number] for number in rest), "at rest every active-low terminal is on"
