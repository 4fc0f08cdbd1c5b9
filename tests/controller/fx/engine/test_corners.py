"""Edge cases of the FX2N engine: rules that are easily misinterpreted, and scans that never end."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.cli.main import main as controller
from controller.fx.drawing.ladder import draw
from controller.fx.engine import operations
from controller.fx.engine.cpu import WATCHDOG_ERROR
from controller.fx.engine.plc import FxPlc
from controller.fx.language.il import read_il
from controller.fx.language.instruction import LadderError
from controller.fx.stimulus.running import run
from controller.fx.stimulus.stimulus import load_stimulus
from tests.sampling import first_of

OFF, ON = [False] * 16, [True] + [False] * 15


def plc(*lines: str) -> FxPlc:
    return FxPlc(read_il("\n".join([*lines, "END"])), input_filter_ms=0)


def outputs(running: FxPlc, levels: list[bool], now_ms: int = 0) -> list[bool]:
    return running.scan(now_ms, levels)[:3]


# NOP


def test_nop_after_an_output_has_no_effect() -> None:
    running = plc("LD X0", "OUT Y0", "NOP", "OUT Y1", "NOP", "AND X1", "OUT Y2")
    assert outputs(running, OFF) == [False, False, False]
    assert outputs(running, ON) == [True, True, False]
    assert outputs(running, [True, True, *OFF[2:]]) == [True, True, True]


def test_nop_between_joined_steps_leaves_them_joined() -> None:
    running = plc("STL S20", "NOP", "STL S21", "OUT Y0", "RET")
    running.memory.S[21] = True
    assert not outputs(running, OFF)[0]
    running.memory.S[20] = True
    assert outputs(running, OFF)[0]


# coils in many steps


@pytest.mark.parametrize("count", first_of([8, 9, 60, 200], 3))
def test_a_coil_driven_by_many_steps_turns_off_after_the_last_active_one(count: int) -> None:
    """When a step turns off, its coil is not affected while any other step that drives it is active."""
    steps = [(f"STL S{n}", "LD X0", "OUT Y0", "LD X1", f"OUT M{n}") for n in range(count)]
    running = plc(*(line for step in steps for line in step), "RET")
    states = running.memory.S
    states[0] = states[count - 1] = True
    seen = []
    for change in (None, 0, None, count - 1, None):
        if change is not None:
            states[change] = False
        seen.append(outputs(running, ON)[0])
    assert seen == [True, True, True, False, False]


# time in STOP


def test_a_retentive_timer_does_not_count_in_stop_nor_without_power() -> None:
    running = plc("LD X0", "OUT T250 K500")
    for now_ms in range(0, 1_100, 100):
        running.scan(now_ms, ON)
    assert running.memory.TV[250] == 10
    running.stop()
    running.scan(5_000, ON)
    running.run()
    running.scan(11_000, ON)
    assert running.memory.TV[250] == 10
    running.power_cycle()
    running.scan(61_000, ON)
    running.scan(61_100, ON)
    assert running.memory.TV[250] == 11
    assert not running.memory.T[250]


def test_plain_timer_retained_by_m8033_continues_from_its_value() -> None:
    running = plc("LD M8000", "OUT M8033", "LD X0", "OUT T0 K50")
    for now_ms in range(0, 1_100, 100):
        running.scan(now_ms, ON)
    running.stop()
    running.run()
    running.scan(20_000, ON)
    assert running.memory.TV[0] == 10


# endless scans


@pytest.mark.parametrize(
    "lines",
    [
        ("P0", "LD M8000", "WDT", "LD M8000", "CJ P0"),
        (
            "LD M8000",
            *["CALL P1"] * 60,
            "FEND",
            *(line for n in range(1, 5) for line in (f"P{n}", "LD M8000", *[f"CALL P{n + 1}"] * 60, "SRET")),
            "P5",
            "LD X0",
            "OUT M0",
            "SRET",
        ),
    ],
    ids=["WDT in an endless loop", "60 to the fifth calls"],
)
@pytest.mark.parametrize("longest_ms", first_of([500, operations.LONGEST_SCAN_MS]))
def test_endless_scans_are_stopped(lines: tuple[str, ...], longest_ms: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operations, "LONGEST_SCAN_MS", longest_ms)
    running = plc(*lines)
    assert running.scan(0, ON) == [False] * 256
    assert running.error is not None
    assert running.memory.M[8061]
    assert running.memory.D[8061] == WATCHDOG_ERROR
    assert (running.memory.M[8004], running.memory.D[8004]) == (True, 8061)
    running.run()
    assert not running.memory.M[8061]


# loops and jumps


def test_for_with_a_count_out_of_range_runs_once_and_sets_m8067() -> None:
    running = plc("LD M8000", "MOV K5000 Z0", "FOR D7990Z0", "LD M8000", "INC D0", "NEXT")
    running.scan(0, OFF)
    assert running.memory.D[0] == 1
    assert (running.memory.M[8067], running.memory.D[8067]) == (True, 6706)
    assert running.memory.D[8004] == 8067


def test_jump_over_master_control_within_a_loop_finds_it_on() -> None:
    running = plc("FOR K2", "LD X0", "CJ P1", "LD X1", "MC N0 M0", "P1", "LD X0", "OUT Y0", "MCR N0", "NEXT")
    assert outputs(running, ON)[0]


def test_jump_to_code_after_fend() -> None:
    running = plc("LD X0", "CJ P1", "LD X1", "OUT Y0", "FEND", "P1", "LD X2", "OUT Y1")
    assert outputs(running, [False, True, True, *OFF[3:]]) == [True, False, False]
    assert outputs(running, [True, False, True, *OFF[3:]]) == [True, True, False]


def test_closing_a_level_of_master_control_closes_inner_levels() -> None:
    running = plc("LD X0", "MC N0 M0", "LD X1", "MC N1 M1", "LD M8000", "OUT Y0", "MCR N0", "LD M8000", "OUT Y1")
    assert outputs(running, OFF) == [False, True, False]
    assert outputs(running, [True, True, *OFF[2:]]) == [True, True, False]


# rejected and accepted programs


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("LD X7", "DHSCS K3 C234 Y0"), "C234 is not a high-speed counter"),
        (("LD X7", "DHSCR K3 C235 C236"), "only C235 itself can be reset"),
        (("LD X7", "DHSCS K3 C235 I001"), "I001 is not a counter interrupt"),
        (("LD X0", "OUT Y0", "FEND", "I001", "LD X0", "OUT Y1"), "write IRET at its end"),
        (("LD X0", "ZRST M0 M8255"), "extends into the special devices"),
        (("FOR K2", "LD X0", "OUT Y0", "SRET", "NEXT"), "SRET"),
    ],
)
def test_ambiguous_programs_are_rejected(lines: tuple[str, ...], message: str) -> None:
    with pytest.raises(LadderError, match=message):
        plc(*lines)


def test_counter_with_preset_0_is_done_at_the_first_edge() -> None:
    running = plc("LD X0", "OUT C0 K0", "LD C0", "OUT Y0")
    assert not outputs(running, OFF)[0]
    assert outputs(running, ON)[0]


def test_annunciator_set_in_a_step_is_not_a_transfer() -> None:
    running = plc("LD M8002", "SET S20", "STL S20", "LD X0", "SET S900", "RET")
    for now_ms in (0, 10, 20):
        running.scan(now_ms, ON)
    assert running.memory.S[20]
    assert running.memory.S[900]


def test_power_up_restores_special_and_index_registers() -> None:
    running = plc("LD X0", "MOV K10 D8000", "LD X0", "MOV K5 Z0")
    running.scan(0, ON)
    running.power_cycle()
    running.scan(10, OFF)
    assert (running.memory.D[8000], running.memory.D[8028]) == (200, 0)


# callers of the engine


def test_constant_scan_is_applied(tmp_path: Path) -> None:
    """If M8039 is on and D8039 is 50, the scan period changes from 10 ms to 50 ms after the first scan."""
    stimulus = tmp_path / "s.yaml"
    stimulus.write_text("scan_ms: 10\nscans: 4\nwatch: [D8010]\n", encoding="utf-8")
    ladder = read_il("LD M8000\nMOV K50 D8039\nOUT M8039\nEND\n")
    assert [scan["ms"] for scan in run(ladder, load_stimulus(stimulus))] == [0, 50, 100, 150]


def test_long_titles_and_non_xml_characters_are_drawn() -> None:
    ladder = read_il("".join(f"; line {n} of a long heading\n" for n in range(6)) + "LD X0\nOUT Y0 ; \uffff\nEND\n")
    names = list(draw(ladder))
    assert all(len(name) < 80 for name in names)
    assert not any("\uffff" in text for text in draw(ladder).values())


def test_command_errors_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    deep = tmp_path / "deep.il"
    deep.write_text("LD X0\n" + "AND X1\nOR X2\n" * 3_000 + "OUT Y0\nEND\n", encoding="utf-8")
    label = tmp_path / "label.il"
    label.write_text("STL S20\nLD X0\nOUT Y0\nP1\nLD X1\nOUT Y1\nRET\nEND\n", encoding="utf-8")
    out = tmp_path / "out"
    for arguments in (
        ["draw", str(deep), "--out", str(out)],
        ["check", str(label)],
        ["export", "--target", "openplc", "--stepper", "plsy", "--out", str(out)],
    ):
        assert controller(["ladder", *arguments]) == 2
        printed = capsys.readouterr()
        assert printed.err.count("\n") == 1
        assert not printed.out
    assert not out.exists()
