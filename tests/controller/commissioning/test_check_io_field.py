"""``check-io`` with a field file: couplers with watchdog and write lock, trips, and a lost device among several."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.controller.commissioning.commissioning_rig import LIMIT_S, REPEAT_S, Person, refusal
from tests.controller.io.field.field_rig import INPUT_TAGS, OUTPUT_TAGS, at_rest, device, file_of, tcp, wires
from tests.controller.io.field.modules import Beckhoff, Box, Coupler, Wago
from tests.controller.io.field.servers import TcpModule
from tests.paths import ROOT
from tests.sampling import first_of

WATCHDOG_MS = 6_000
"""Time of the output watchdogs, longer than the timeout of the devices; it is advanced by the tests only."""
OPEN, CLOSE = "Y15", "Y16"
"""Left claws: outputs without a sensor, so that nothing but the person ends the attempt."""
HELD = OUTPUT_TAGS.index("left.claws_open")
PROFILES: dict[str, Callable[[], Coupler]] = {
    "beckhoff-ek9000": Beckhoff,
    "beckhoff-bk9000": lambda: Beckhoff(has_lock=False),
    "wago-750": Wago,
}


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


class Rig:
    """Sensors and the tray as bits, the valves on a coupler, and a person in front of ``check-io``."""

    def __init__(self, stack: ExitStack, folder: Path, profile: str, *, is_tripped: bool = False) -> None:
        self.sensors, self.left, self.claws = Box(), PROFILES[profile](), Box()
        self.left.is_tripped, self.left.trips = is_tripped, int(is_tripped)
        boxes = (self.sensors, self.left, self.claws)
        self.modules = [stack.enter_context(TcpModule(box)) for box in boxes]
        first, second, third = (tcp(module.port) for module in self.modules)
        at_rest(self.sensors)
        # A combined exchange needs an input at the coupler.
        inputs, others = INPUT_TAGS[:-1], OUTPUT_TAGS[-1:]
        left = wires(INPUT_TAGS[-1:])[:-1] + ", " + wires(OUTPUT_TAGS[:-1])[1:]
        at_rest(self.left, INPUT_TAGS[-1:])
        path = file_of(
            folder,
            device("sensors", "inputs-only", first, wires(inputs)),
            device("valves", profile, second, left, f"watchdog_ms: {WATCHDOG_MS}"),
            device("tray", "coils", third, wires(others), f"watchdog_ms: {WATCHDOG_MS}"),
        )
        only = ("--only", OPEN, "--only", CLOSE)
        self.person = stack.enter_context(Person(None, folder, "--field", str(path), *only))

    def hold(self) -> None:
        """Hold the key until the output is on."""
        self.until(lambda: self.left.outputs[HELD], key=" ")

    def until(self, condition: Callable[[], bool], key: str = "") -> None:
        for _ in range(round(LIMIT_S / REPEAT_S)):
            if condition():
                return
            if key:
                self.person.press(key)
            threading.Event().wait(REPEAT_S)
        pytest.fail("the condition was not reached")

    def report(self) -> str:
        (path,) = self.person.folder.glob("*.md")
        return path.read_text(encoding="utf-8")


EVERY_PROFILE = pytest.mark.parametrize("profile", first_of(PROFILES))


@EVERY_PROFILE
def test_the_watchdog_is_served_while_the_command_waits_for_the_person(
    profile: str, stack: ExitStack, tmp_path: Path
) -> None:
    rig = Rig(stack, tmp_path, profile)
    for prompt in ("area clear", "hold SPACE", "did exactly"):
        line = rig.person.until(prompt)
        for _ in range(3):
            rig.until(lambda: rig.left.left_ms == rig.left.watchdog_ms > 0)
            rig.left.advance(rig.left.watchdog_ms - 1)
        assert not rig.left.is_tripped
        rig.person.answer(line)
    assert rig.person.work() == 0
    assert not any(rig.left.outputs)
    assert f"Field I/O: sensors (127.0.0.1:{rig.modules[0].port}), valves (" in rig.report()


@EVERY_PROFILE
def test_a_trip_before_the_outputs_is_reset_after_the_confirmation_and_reported(
    profile: str, stack: ExitStack, tmp_path: Path
) -> None:
    rig = Rig(stack, tmp_path, profile, is_tripped=True)
    rig.person.until("Is the output watchdog")
    assert not rig.left.writes, "the module is reset without the person"
    rig.person.press("y")
    assert "had tripped; it has been reset" in (rig.person.next_line() or "")
    assert not rig.left.is_tripped
    assert rig.person.work() == 0


@EVERY_PROFILE
def test_a_trip_during_the_check_ends_it_and_is_reported(profile: str, stack: ExitStack, tmp_path: Path) -> None:
    rig = Rig(stack, tmp_path, profile)
    rig.person.until("hold SPACE")
    rig.hold()
    rig.left.advance(WATCHDOG_MS)
    label = f"valves (127.0.0.1:{rig.modules[1].port})"
    assert rig.person.next_line() == f"The output watchdog of {label} has tripped; the check ends."
    assert rig.person.work() == 1
    assert "End of the check: output watchdog of a module tripped" in rig.report()
    assert {result for result, _ in rig.person.results().values()} == {"not_tested"}


@pytest.mark.parametrize("lost", first_of([0, 2]), ids=["sensors", "tray"])
def test_a_lost_device_leaves_no_output_on_at_the_others(lost: int, stack: ExitStack, tmp_path: Path) -> None:
    """The watchdog of the coupler is not advanced: the command itself writes the safe outputs."""
    rig = Rig(stack, tmp_path, "wago-750")
    rig.person.until("hold SPACE")
    rig.hold()
    rig.modules[lost].unplug()
    assert "no response from the field I/O" in (rig.person.next_line() or "")
    assert not any(rig.left.outputs)
    assert rig.person.work() == 1
    assert "End of the check: field I/O lost" in rig.report()


@pytest.mark.nightly
def test_enter_alone_is_no_verdict_on_an_output_that_was_never_on(stack: ExitStack, tmp_path: Path) -> None:
    rig = Rig(stack, tmp_path, "wago-750")
    rig.person.until("hold SPACE")
    rig.person.press("\n")
    assert "hold SPACE" in (rig.person.next_line() or "")
    rig.person.press("q")
    assert rig.person.work() == 1
    assert {result for result, _ in rig.person.results().values()} == {"not_tested"}


def test_the_example_of_a_field_file_is_accepted_and_a_short_watchdog_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    example = ROOT / "docs" / "examples" / "field.yaml"
    short = tmp_path / "field.yaml"
    short.write_text(example.read_text(encoding="utf-8").replace("watchdog_ms: 300", "watchdog_ms: 50"))
    for path, message in (
        (example, "check-io: standard input is not a terminal"),
        (short, f"{short}:36: valves.watchdog_ms: 50 ms is not longer than the timeouts plus the polling interval"),
    ):
        assert refusal(["--field", str(path), "--out", str(tmp_path)], capsys).startswith(message)
