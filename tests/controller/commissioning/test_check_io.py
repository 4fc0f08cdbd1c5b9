"""``check-io`` in a pseudo-terminal with a scripted person, on a plant with each class of wiring error."""

from __future__ import annotations

import os
import signal
import socket
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from controller.common.modbus.io_map import IoMap
from plant_sim.faults.fault import Fault
from plant_sim.machine.plant import Plant
from tests.controller.commissioning.commissioning_rig import (
    IO_MAP,
    LIMIT_S,
    REPEAT_S,
    WATCHDOG_MS,
    Person,
    WiredPlant,
    inverted,
    refusal,
    swapped,
    wired_plant,
)
from tests.real_time import host_delay
from tests.sampling import one_in


def only(*tags: str) -> list[str]:
    return [word for tag in tags for word in ("--only", tag)]


@pytest.mark.nightly
def test_every_point_of_a_machine_without_errors_is_correct(tmp_path: Path) -> None:
    with wired_plant() as plant, Person(plant, tmp_path) as person:
        code = person.work()
        assert not any(plant.outputs())
    assert person.faults() == {}
    assert code == 0


def test_an_arm_without_errors_is_checked_in_an_order_that_its_interlocks_permit(tmp_path: Path) -> None:
    motions = ("lift_extend", "lift_retract", "slide_inward", "slide_outward", "converge", "spread")
    with (
        wired_plant() as plant,
        Person(plant, tmp_path, *only(*(f"left.{motion}" for motion in motions)), "--tester", "A. Engineer") as person,
    ):
        code = person.work()
    assert person.faults() == {}
    assert code == 0
    assert person.asked == ["Y2", "Y12", "Y11", "Y1", "Y5", "Y6"]
    (path,) = tmp_path.glob("*.md")
    text = path.read_text(encoding="utf-8")
    assert "**6 of 6 points correct, 0 faulty, 0 not tested**" in text
    assert "| Tested by | A. Engineer | &nbsp; | &nbsp; |" in text
    assert "| Address | Point | Result | Remark | Time (UTC) |" in text
    assert "- Output watchdog and emergency stop confirmed: yes\n- End of the check: complete" in text


def merged(*maps: IoMap) -> IoMap:
    """Return a map with the changed wires of all maps."""

    def points(name: str) -> tuple[object, ...]:
        original = getattr(IO_MAP, name)
        by_tag = {point.tag: point for point in original}
        for each in maps:
            by_tag |= {point.tag: point for point in getattr(each, name) if point not in original}
        return tuple(sorted(by_tag.values(), key=lambda point: point.number))

    return replace(IO_MAP, inputs=points("inputs"), outputs=points("outputs"))  # type: ignore[arg-type]


def test_each_class_of_error_at_inputs_is_found_and_named(tmp_path: Path) -> None:
    """A swapped pair, inverted, dead and stuck inputs, open and closed contacts, beside correct ones."""

    def prepare(plant: Plant) -> None:
        plant.broken_wires.update({"right.claws_spread", "emergency_stop"})
        plant.sensors["left.cup_pulse"].stuck = True

    wiring = merged(swapped("left.slide_at_pick_1", "right.lift_up"), inverted("left.lift_up"), inverted("stop"))
    expected = {
        "left.slide_at_pick_1": ("swapped", "X4"),
        "right.lift_up": ("swapped", "X6"),
        "left.lift_up": ("inverted", ""),
        "stop": ("inverted", ""),
        "right.claws_spread": ("dead", ""),
        "emergency_stop": ("dead", ""),
        "left.cup_pulse": ("stuck", ""),
    }
    correct = ("start", "left.lift_down", "left.slide_at_feed")
    with (
        wired_plant(wiring, prepare) as plant,
        Person(plant, tmp_path, *only(*expected, *correct), dead=["left.cup_pulse"]) as person,
    ):
        code = person.work()
        assert plant.module.last_write_ms is None, "the check of inputs has written outputs"
    assert person.results() == expected | dict.fromkeys(correct, ("ok", ""))
    assert code == 1


@pytest.mark.parametrize(
    ("wiring", "faults", "tags", "expected"),
    one_in(
        3,
        [
            (
                swapped("left.lift_extend", "left.lift_retract"),
                [],
                ("left.lift_extend", "left.lift_retract"),
                {"left.lift_extend": ("swapped", "Y2"), "left.lift_retract": ("swapped", "Y1")},
            ),
            (
                swapped("left.slide_inward", "left.slide_outward"),
                [],
                ("left.slide_inward", "left.slide_outward"),
                {"left.slide_inward": ("swapped", "Y6"), "left.slide_outward": ("swapped", "Y5")},
            ),
            (
                swapped("left.lift_retract", "right.lift_retract"),
                [],
                ("left.lift_retract", "right.lift_retract"),
                {"left.lift_retract": ("swapped", "Y4"), "right.lift_retract": ("swapped", "Y2")},
            ),
            (
                IO_MAP,
                [Fault("stuck_valve", "right.lift")],
                ("right.lift_retract", "left.lift_retract"),
                {"right.lift_retract": ("dead", "")},
            ),
            (
                inverted("left.slide_inward"),
                [],
                ("left.slide_inward", "right.lift_retract"),
                {"left.slide_inward": ("uncommanded", "")},
            ),
        ],
    ),
    ids=["swapped pair of a lift", "swapped pair of a slide", "swapped arms", "dead", "inverted"],
)
def test_each_class_of_error_at_outputs_is_found_and_named(
    wiring: IoMap, faults: list[Fault], tags: tuple[str, ...], expected: dict[str, tuple[str, str]], tmp_path: Path
) -> None:
    def prepare(plant: Plant) -> None:
        for fault in faults:
            plant.faults.add(fault)

    with wired_plant(wiring, prepare) as plant, Person(plant, tmp_path, *only(*tags)) as person:
        code = person.work()
    assert person.faults() == expected
    assert code == 1


def test_outputs_without_a_sensor_are_judged_by_the_person(tmp_path: Path) -> None:
    with (
        wired_plant() as plant,
        Person(
            plant,
            tmp_path,
            *only("left.claws_open", "left.claws_close", "right.claws_open"),
            seen={"Y15": "o", "Y16": "n"},
            answers={"What moved": "y17\n"},
        ) as person,
    ):
        assert person.work() == 1
    assert person.results() == {
        "left.claws_open": ("swapped", "Y17"),
        "left.claws_close": ("dead", ""),
        "right.claws_open": ("ok", ""),
    }


@pytest.mark.nightly
def test_outputs_of_an_axis_with_a_faulty_sensor_are_judged_by_eye(tmp_path: Path) -> None:
    with (
        wired_plant(inverted("left.lift_up")) as plant,
        Person(plant, tmp_path, *only("left.lift_up", "left.lift_retract")) as person,
    ):
        person.work()
    assert "Y2 left lift cylinder retracts: arm up: correct (judged by eye)" in person.said


def test_without_the_confirmed_watchdog_no_output_is_written(tmp_path: Path) -> None:
    with (
        wired_plant() as plant,
        Person(plant, tmp_path, *only("outputs"), answers={"output watchdog": "n"}) as person,
    ):
        assert person.work() == 1
        assert plant.module.last_write_ms is None
    assert {result for result, _ in person.results().values()} == {"not_tested"}


def test_interlocks_and_the_emergency_stop_refuse_an_output(tmp_path: Path) -> None:
    with wired_plant() as plant, Person(plant, tmp_path, *only("left.spread", "right.lift_retract")) as person:
        person.until("area clear")
        plant.operate("emergency_stop", state=True)
        person.answer(person.said[-1])
        person.work()
    assert any("not permitted now: emergency stop is active" in line for line in person.said)
    assert person.results() == {"left.spread": ("not_tested", ""), "right.lift_retract": ("not_tested", "")}


HELD = "Y15"
"""Output held in the tests below, the left claws open, and its number: it has no sensor that would end the attempt."""
HELD_NUMBER = IO_MAP["left.claws_open"].number


class Repeater:
    """Key repetition of a terminal in a thread, until it ends."""

    def __init__(self, person: Person) -> None:
        self._ends = threading.Event()
        self._person = person
        self._thread = threading.Thread(target=self._repeat)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()

    def _repeat(self) -> None:
        while not self._ends.wait(REPEAT_S):
            try:
                self._person.press(" ")
            except OSError:  # the terminal has been closed
                return


def wait_until(condition: Callable[[], bool]) -> None:
    for _ in range(round(LIMIT_S / REPEAT_S)):
        if condition():
            return
        threading.Event().wait(REPEAT_S)
    pytest.fail("the condition was not reached")


def is_on(plant: WiredPlant) -> bool:
    return plant.outputs()[HELD_NUMBER]


def test_an_output_is_on_only_while_the_key_is_held(tmp_path: Path) -> None:
    with wired_plant() as plant, Person(plant, tmp_path, *only(HELD)) as person:
        ever: list[list[bool]] = []
        plant.thread.call(lambda: plant.module.observers.append(lambda: ever.append(plant.module.outputs)))
        person.until("hold SPACE")
        person.press(" ")  # a single press
        assert person.next_line(within_s=1.0) is None
        assert not any(any(image) for image in ever)
        for _ in range(2):
            with Repeater(person):
                wait_until(lambda: is_on(plant))
            wait_until(lambda: not is_on(plant))
        with Repeater(person):
            wait_until(lambda: is_on(plant))
            person.press("x")  # another key ends the attempt
            assert "hold SPACE" in (person.next_line() or "")
        assert {sum(image) for image in ever} == {0, 1}, "two outputs were on together"
        assert not plant.module.tripped


@pytest.mark.parametrize("end", one_in(2, ["SIGINT", "SIGTERM", "SIGQUIT", "closed terminal"]))
def test_the_command_leaves_no_output_on_at_any_end(end: str, tmp_path: Path) -> None:
    """In lock step, no plant time passes after the last write: the watchdog of the module cannot trip."""
    with wired_plant() as plant, Person(plant, tmp_path, *only(HELD)) as person:
        person.until("hold SPACE")
        with Repeater(person):
            wait_until(lambda: is_on(plant))
            if end == "closed terminal":
                os.close(person.terminal)
                person.terminal = -1
            else:
                person.process.send_signal(signal.Signals[end])
            wait_until(lambda: not is_on(plant))
        assert person.process.wait(LIMIT_S) == 1
        assert not plant.module.tripped
        (report,) = tmp_path.glob("*.md")
        assert "End of the check: request to stop, or terminal lost" in report.read_text(encoding="utf-8")


def test_the_watchdog_of_the_module_leaves_no_output_on_after_a_kill(tmp_path: Path) -> None:
    watchdog_ms = host_delay().relative_ms(4 * WATCHDOG_MS)  # longer than any pause of a busy computer before the kill
    with (
        wired_plant(lock_step_ms=None, watchdog_ms=watchdog_ms) as plant,
        Person(plant, tmp_path, *only(HELD)) as person,
    ):
        person.until("hold SPACE")
        with Repeater(person):
            wait_until(lambda: is_on(plant))
            person.process.kill()
            wait_until(lambda: not is_on(plant))
    assert plant.module.tripped
    assert plant.module.tripped_at_ms == (plant.module.last_write_ms or 0) + watchdog_ms + 1
    assert not [*tmp_path.glob("*.md")]


def test_a_lost_field_ends_the_check_with_a_report(tmp_path: Path) -> None:
    with wired_plant() as plant, Person(plant, tmp_path, *only(HELD, "Y16")) as person:
        person.until("hold SPACE")
        with Repeater(person):
            wait_until(lambda: is_on(plant))
            plant.thread.call(plant.thread.server.end)
            assert "no response from the field I/O" in (person.next_line() or "")
        assert person.work() == 1
    assert [*person.results().values()] == [("not_tested", "")] * 2


def test_the_emergency_stop_ends_a_motion(tmp_path: Path) -> None:
    with wired_plant() as plant, Person(plant, tmp_path, *only(HELD)) as person:
        person.until("hold SPACE")
        with Repeater(person):
            wait_until(lambda: is_on(plant))
            plant.operate("emergency_stop", state=True)
            assert person.next_line() == "off: emergency stop is active"
            assert not is_on(plant)


def test_texts_and_report_in_chinese(tmp_path: Path) -> None:
    with (
        wired_plant() as plant,
        Person(plant, tmp_path, *only("X0"), "--language", "zh") as person,
    ):
        line = person.until("不要动作")
        assert line == "X0 启动按钮按下：不要动作，然后按回车"
        person.press("\n")
        person.until("使其动作并保持")
        plant.operate("start", state=True)
        person.press("\n")
        assert person.work() == 0
    (path,) = tmp_path.glob("*.md")
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# 输入输出检查报告\n")
    assert "| X0 | 启动按钮按下 | 正确 |" in text


def test_invalid_use_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    for arguments, message in (
        (["--only", "X99"], f"--only X99: no such point in {IO_MAP.path}; use one of inputs, outputs, "),
        (["--out", str(tmp_path / "file" / "x")], f"--out {tmp_path}/file/x: Not a directory; choose a"),
        (
            ["--out", str(tmp_path / "new")],
            "check-io: standard input is not a terminal; outputs are switched by a held",
        ),
    ):
        assert refusal(arguments, capsys).startswith(message)
        assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_outputs_in_use_and_a_missing_field_are_refused(tmp_path: Path) -> None:
    with wired_plant(lock_step_ms=None) as plant:
        plant.thread.call(lambda: plant.module.lease.take("10.0.0.9:1234"))
        with Person(plant, tmp_path) as person:
            assert person.work() == 2
        assert person.said == ["check-io: outputs are in use: 10.0.0.9:1234; stop the other controller first"]
        assert plant.module.last_write_ms is None
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = str(reserved.getsockname()[1])
    with Person(plant, tmp_path, "--port", port) as person:
        assert person.work() == 2
    assert person.said[0].startswith(f"check-io: no field I/O at 127.0.0.1:{port}: not reachable within 5000 ms")
    assert not [*tmp_path.iterdir()]
