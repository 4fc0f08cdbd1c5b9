"""Engine tests beyond the conformance files: RUN and STOP, watchdog, special devices, errors, arbitrary networks."""

from __future__ import annotations

from itertools import pairwise

import pytest

from controller.core.devices import RETENTIVE, SIZES
from controller.fx.engine.plc import FxPlc
from controller.fx.language.il import read_il
from controller.fx.language.instruction import LadderError

OFF = [False] * SIZES["Y"]


def plc_of(text: str) -> FxPlc:
    """Return a PLC that runs a program given as instructions separated by slashes; END is appended."""
    return FxPlc(read_il("\n".join([*text.split(" / "), "END"])), input_filter_ms=0)


def levels(*on: int) -> list[bool]:
    """Return the levels of the X terminals, with the given terminals on."""
    return [number in on for number in range(16)]


def on(image: list[bool] | None) -> set[int]:
    assert image is not None
    return {number for number, level in enumerate(image) if level}


def stopped_by(plc: FxPlc) -> int | None:
    return plc.error.code if plc.error else None


# watchdog

ENDLESS = {
    "CJ backwards": "P0 / LD M8000 / INC D0 / LD M8000 / CJ P0",
    "CJ to itself": "P0 / LD M8000 / CJ P0",
    "FOR nested": "FOR K32767 / FOR K32767 / LD M8000 / INC D0 / NEXT / NEXT",
    "FOR without a body": "FOR K32767 / FOR K32767 / FOR K32767 / NEXT / NEXT / NEXT",
}


@pytest.mark.parametrize("text", ENDLESS.values(), ids=ENDLESS)
def test_watchdog_ends_an_endless_loop(text: str) -> None:
    plc = plc_of(f"LD M8000 / OUT Y0 / LD X0 / CJ P9 / {text} / P9")
    plc.memory.D[8000] = 20
    assert on(plc.scan(0, levels(0))) == {0}
    assert stopped_by(plc) is None
    assert plc.scan(10, levels()) == OFF
    assert stopped_by(plc) == 6105
    assert (plc.memory.M[8061], plc.memory.D[8061], plc.running) == (True, 6105, False)
    count = plc.memory.D[0]
    assert plc.scan(20, levels(0)) == OFF
    assert plc.memory.D[0] == count
    plc.run()
    assert on(plc.scan(30, levels(0))) == {0}


def test_wdt_restarts_the_watchdog() -> None:
    loop = "FOR K10000 / LD M8000 / INC D0 / LD X0 / WDT / NEXT"
    plc = plc_of(loop)
    plc.memory.D[8000] = 1
    plc.scan(0, levels(0))
    assert (plc.error, plc.memory.D[0]) == (None, 10000)
    plc.scan(10, levels())
    assert plc.error is not None
    assert plc.error.relay == 8061


def test_watchdog_restarts_with_each_scan() -> None:
    plc = plc_of("FOR K1000 / LD M8000 / INC D0 / NEXT")
    plc.memory.D[8000] = 1
    for now_ms in range(0, 100, 10):
        plc.scan(now_ms, levels())
    assert (plc.error, plc.memory.D[0]) == (None, 10000)


# RUN and STOP


def test_initial_pulse_in_the_first_scan_of_every_run() -> None:
    plc = plc_of("LD M8002 / INC D0 / LD M8003 / INC D1 / LD M8000 / INC D2 / LD M8001 / INC D3")
    for now_ms in (0, 10, 20):
        plc.scan(now_ms, levels())
    assert plc.memory.D[:4] == [1, 2, 3, 0]
    plc.memory.M[8033] = True
    plc.stop()
    plc.scan(30, levels())
    assert plc.memory.D[:4] == [1, 2, 3, 0]
    plc.run()
    plc.scan(40, levels())
    assert plc.memory.D[:4] == [2, 2, 4, 0]


SOME_OF_EACH = (
    "LD X0 / SET Y1 / SET M0 / SET M500 / SET S20 / SET S500 / MOV K7 D0 / MOV K7 D200 / OUT T0 K1 / OUT T250 K1"
)


@pytest.mark.parametrize("hold", [False, True])
def test_stop_retains_latched_devices_and_with_m8033_all_devices(hold: bool) -> None:
    plc = plc_of(SOME_OF_EACH)
    plc.scan(0, levels(0))
    assert on(plc.scan(100, levels(0))) == {1}
    plc.memory.M[8033] = hold
    plc.stop()
    assert on(plc.scan(200, levels())) == ({1} if hold else set())
    memory = plc.memory
    assert [memory.M[0], memory.S[20], memory.T[0], memory.TV[0] == 1, memory.D[0] == 7, memory.Y[1]] == [hold] * 6
    assert (memory.M[500], memory.S[500], memory.T[250], memory.TV[250], memory.D[200]) == (True, True, True, 1, 7)


def test_m8033_does_not_retain_outputs_after_an_error() -> None:
    plc = plc_of("LD M8000 / OUT Y0 / SET M8033 / P0 / LD X0 / CJ P0")
    plc.memory.D[8000] = 1
    assert on(plc.scan(0, levels())) == {0}
    assert plc.scan(10, levels(0)) == OFF
    assert plc.scan(20, levels(0)) == OFF


def test_m8034_turns_off_the_terminals_but_not_the_image() -> None:
    plc = plc_of("LD M8000 / OUT Y0 / LD X0 / OUT M8034 / LD Y0 / INC D0")
    assert [on(plc.scan(now, levels(*x))) for now, x in ((0, ()), (10, (0,)), (20, ()))] == [{0}, set(), {0}]
    assert plc.memory.D[0] == 3
    assert plc.memory.Y[0]


def test_m8037_stops_and_m8035_with_m8036_runs() -> None:
    plc = plc_of("LD M8000 / INC D200 / LD M8002 / INC D201 / LD X0 / SET M8037")
    plc.scan(0, levels(0))
    assert plc.memory.D[200] == 1
    plc.scan(10, levels())
    assert (plc.running, plc.memory.M[8037], plc.memory.D[200]) == (False, False, 1)
    plc.memory.M[8036] = True
    plc.scan(20, levels())
    assert plc.memory.D[200] == 1, "M8036 alone does not run"
    plc.memory.M[8035] = True
    plc.scan(30, levels())
    assert (plc.running, plc.memory.D[200], plc.memory.D[201]) == (True, 2, 2)


def fill(plc: FxPlc) -> None:
    """Set all devices except special devices."""
    memory = plc.memory
    for kind in "YMSTC":
        size = min(SIZES[kind], 8000)
        memory.bits(kind)[:size] = [True] * size
    memory.D[:8000] = [5] * 8000
    memory.TV[:], memory.CV[:] = [5] * SIZES["T"], [5] * SIZES["C"]


def retained_devices(plc: FxPlc) -> dict[str, set[int]]:
    """Return the numbers of the devices that are not cleared, excluding special devices."""
    memory = plc.memory
    cells = {kind: memory.bits(kind) for kind in "YMSTC"} | {"D": memory.D, "TN": memory.TV, "CN": memory.CV}
    return {kind: {number for number, value in enumerate(row[:8000]) if value} for kind, row in cells.items()}


LATCHED = {
    "Y": set(),
    "M": set(range(500, 3072)),
    "S": set(range(500, 1000)),
    "T": set(range(246, 256)),
    "TN": set(range(246, 256)),
    "C": {*range(100, 200), *range(220, 256)},
    "CN": {*range(100, 200), *range(220, 256)},
    "D": set(range(200, 8000)),
}


def test_power_cycle_retains_exactly_the_latched_devices() -> None:
    plc = plc_of("LD M8002 / INC D8100")
    plc.scan(0, levels())
    fill(plc)
    plc.power_cycle()
    found = retained_devices(plc)
    found["M"] &= set(range(3072))
    assert found == LATCHED
    assert RETENTIVE.keys() == set("MSTCD")
    plc.scan(10, levels())
    assert plc.memory.D[8100] == 2


@pytest.mark.parametrize(("relay", "clears_latched"), [(8031, False), (8032, True)])
def test_m8031_and_m8032_clear_their_part(relay: int, clears_latched: bool) -> None:
    plc = plc_of("LD M8000 / OUT M8100")
    fill(plc)
    before = retained_devices(plc)
    plc.memory.M[relay] = True
    plc.scan(0, levels())
    found = retained_devices(plc)
    latched = {kind: before[kind] & LATCHED[kind] for kind in before}
    expected = {kind: before[kind] - latched[kind] if clears_latched else latched[kind] for kind in before}
    found["M"] &= set(range(3072))
    expected["M"] &= set(range(3072))
    assert found == expected
    assert (plc.memory.M[relay], plc.memory.M[8100]) == (False, True)


@pytest.mark.parametrize("restart", ["run", "power_cycle"])
def test_instruction_state_is_reset_when_run_begins(restart: str) -> None:
    plc = plc_of("LD M8000 / PLSY K10 K3 Y0 / LD M8029 / OUT M500")
    for now_ms in (0, 100, 200, 300, 400):
        plc.scan(now_ms, levels())
    assert (plc.memory.D[8140], plc.memory.M[500]) == (3, True)
    getattr(plc, restart)()
    plc.scan(1000, levels())
    assert (plc.memory.Y[0], plc.memory.M[500]) == (True, False)
    plc.scan(1300, levels())
    assert (plc.memory.D[8140], plc.memory.M[500]) == (6, True)


# outputs before END


def test_ref_outputs_its_range_before_end() -> None:
    plc = plc_of("LD X0 / OUT Y0 / OUT Y10 / LD X1 / REF Y10 K8 / LD M8000 / OUT Y1")
    assert on(plc.scan(0, levels(1))) == {1}
    assert on(plc.refreshed) == set()
    assert on(plc.scan(10, levels(0, 1))) == {0, 1, 8}
    assert on(plc.refreshed) == {1, 8}, "at the terminals, Y0 is still off and Y1 has been on since the previous END"
    plc.scan(20, levels(0))
    assert plc.refreshed is None


def test_ref_starts_with_terminals_off_after_power_up() -> None:
    plc = plc_of("LD M8000 / OUT Y0 / REF Y10 K8")
    plc.scan(0, levels())
    assert on(plc.refreshed) == set()
    plc.scan(10, levels())
    assert on(plc.refreshed) == {0}
    plc.power_cycle()
    plc.scan(20, levels())
    assert on(plc.refreshed) == set()


def test_ref_outputs_nothing_while_outputs_are_disabled_or_in_stop() -> None:
    plc = plc_of("LD X0 / OUT M8034 / LD M8000 / OUT Y0 / REF Y0 K8")
    plc.scan(0, levels())
    assert on(plc.refreshed) == {0}
    plc.scan(10, levels(0))
    assert on(plc.refreshed) == set()
    plc.stop()
    plc.scan(20, levels())
    assert plc.refreshed is None


def test_returned_outputs_are_copies() -> None:
    plc = plc_of("LD M8002 / SET Y0 / REF Y0 K8")
    for image in (plc.scan(0, levels()), plc.refreshed):
        assert image is not None
        image[0] = False
    assert plc.memory.Y[0]
    assert plc.cpu.latches[0]


# special devices


@pytest.mark.parametrize(("relay", "period_ms"), [(8011, 10), (8012, 100), (8013, 1000), (8014, 60_000)])
def test_clocks_are_on_for_half_their_period(relay: int, period_ms: int) -> None:
    plc = plc_of(f"LD M{relay} / OUT Y0")
    quarter = period_ms // 10
    seen = [bool(on(plc.scan(n * quarter, levels()))) for n in range(30)]
    assert seen == ([True] * 5 + [False] * 5) * 3


def test_d8010_to_d8012_are_the_scan_times_in_tenths_of_a_ms() -> None:
    plc = plc_of("LD M8000 / OUT Y0")
    seen = []
    for now_ms in (0, 10, 30, 35, 50):
        plc.scan(now_ms, levels())
        seen.append(tuple(plc.memory.D[8010:8013]))
    assert seen == [(0, 0, 0), (100, 100, 100), (200, 100, 200), (50, 50, 200), (150, 50, 200)]


def test_scan_times_restart_with_run_and_exclude_stop() -> None:
    plc = plc_of("LD M8000 / OUT Y0")
    plc.scan(0, levels())
    plc.scan(5, levels())
    plc.stop()
    plc.scan(1000, levels())
    plc.run()
    plc.scan(2000, levels())
    assert plc.memory.D[8010:8013] == [0, 0, 0]
    plc.scan(2010, levels())
    assert plc.memory.D[8010:8013] == [100, 100, 100]


def test_d8020_is_the_input_filter() -> None:
    plc = FxPlc(read_il("LD X0\nOUT Y0\nEND"), input_filter_ms=20)
    assert plc.memory.D[8020] == 20
    plc.scan(0, levels())
    assert [bool(on(plc.scan(now_ms, levels(0)))) for now_ms in (10, 20, 30)] == [False, False, True]
    plc.memory.D[8020] = 0
    plc.scan(40, levels(0))
    assert not on(plc.scan(50, levels()))


def test_m8046_and_d8040_contain_the_active_states() -> None:
    plc = plc_of("LD X0 / OUT M8047")
    memory = plc.memory
    for state in (899, 20, 21, 22, 23, 24, 25, 26, 27, 900):
        memory.S[state] = True
    plc.scan(0, levels())
    assert not memory.M[8046]
    plc.scan(10, levels(0))
    assert (memory.M[8046], memory.D[8040:8048]) == (True, list(range(20, 28)))
    memory.S[20:28] = [False] * 8
    plc.scan(20, levels(0))
    assert (memory.M[8046], memory.D[8040:8048]) == (True, [899] + [-1] * 7)
    memory.S[899] = False
    plc.scan(30, levels(0))
    assert (memory.M[8046], memory.D[8040:8048]) == (False, [-1] * 8)


def test_m8048_and_d8049_indicate_annunciators_while_m8049_is_on() -> None:
    plc = plc_of("LD X0 / OUT M8049")
    memory = plc.memory
    memory.S[950] = memory.S[999] = memory.S[899] = True
    seen = []
    for now_ms, x in ((0, ()), (10, (0,)), (20, ())):
        plc.scan(now_ms, levels(*x))
        seen.append((memory.M[8048], memory.D[8049]))
    assert seen == [(False, 0), (True, 950), (False, 0)]
    memory.S[950] = memory.S[999] = False
    plc.scan(30, levels(0))
    assert not memory.M[8048]


# index registers, operation errors


@pytest.mark.parametrize(("name", "register"), [("Z0", 8028), ("V0", 8029), ("Z1", 8182), ("V7", 8195)])
def test_index_registers_are_special_registers(name: str, register: int) -> None:
    plc = plc_of(f"LD M8000 / MOV K3 {name} / MOV K77 D10{name}")
    plc.scan(0, levels())
    assert (plc.memory.D[register], plc.memory.D[13]) == (3, 77)


def test_operation_error_is_indicated_and_the_program_continues() -> None:
    plc = plc_of("LD X0 / OUT Y0 / LD X1 / MOV K1 D7999Z0 / LD M8000 / INC D0 / LD X2 / DIV K1 D9 D1")
    memory = plc.memory
    memory.D[8028] = 300
    plc.scan(0, levels())
    assert (memory.M[8067], memory.D[8067], memory.D[0]) == (False, 0, 1)
    plc.scan(10, levels(1))
    assert (memory.M[8067], memory.D[8067], memory.D[8069], memory.D[0]) == (True, 6706, 3, 2)
    plc.scan(20, levels(2))
    assert (plc.running, memory.M[8067], memory.D[8069], memory.D[0]) == (True, True, 13, 3)


def test_comparison_with_an_operation_error_is_false() -> None:
    plc = plc_of("LD= D7999Z0 K0 / OUT Y0")
    assert on(plc.scan(0, levels())) == {0}
    plc.memory.D[8028] = 300
    assert on(plc.scan(10, levels())) == set()
    assert (plc.memory.M[8067], plc.memory.D[8069]) == (True, 0)


# flow


def nest_of_calls(depth: int) -> str:
    calls = [f"P{n} / LD M8000 / INC D0 / CALL P{n + 1} / SRET" for n in range(depth - 1)]
    return " / ".join(["LD M8000 / OUT Y0 / CALL P0 / FEND", *calls, f"P{depth - 1} / LD M8000 / INC D0 / SRET"])


def test_five_nested_subroutines_run_and_a_sixth_stops_the_cpu() -> None:
    good, deep = plc_of(nest_of_calls(5)), plc_of(nest_of_calls(6))
    assert on(good.scan(0, levels())) == {0}
    assert (good.error, good.memory.D[0]) == (None, 5)
    assert deep.scan(0, levels()) == OFF
    assert (deep.memory.M[8066], deep.memory.D[8066], deep.memory.D[0], deep.running) == (True, 6607, 5, False)


def test_a_subroutine_that_calls_itself_stops_the_cpu() -> None:
    plc = plc_of("LD M8000 / CALL P0 / FEND / P0 / LD M8000 / CALL P0 / SRET")
    assert plc.scan(0, levels()) == OFF
    assert plc.memory.M[8066]
    plc.run()
    plc.scan(10, levels())
    assert plc.error is not None


def test_cj_p63_jumps_to_end() -> None:
    plc = plc_of("LD X0 / CJ P63 / LD M8000 / INC D0 / STL S20 / OUT Y0 / RET")
    assert [plc.scan(now, levels(*x)) and plc.memory.D[0] for now, x in ((0, ()), (10, (0,)), (20, ()))] == [1, 1, 2]


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("LD X0 / CJ P1 / STL S20 / OUT Y0 / P1 / LD X1 / OUT Y1 / RET", ":5:1: P1: "),
        ("LD X0 / CJ P1 / FOR K2 / P1 / LD X1 / INC D0 / NEXT", ":2:1: CJ P1: "),
        ("LD X0 / CALL P1 / FEND / P1 / LD X0 / CJ P63 / SRET", ":6:1: CJ P63: "),
    ],
)
def test_unsupported_jump_is_rejected_with_its_location(text: str, place: str) -> None:
    with pytest.raises(LadderError) as caught:
        plc_of(text)
    assert str(caught.value).startswith(f"program{place}")
    assert "; put" in str(caught.value)


@pytest.mark.parametrize(
    ("rung", "powers"),
    [
        ([*["INV"] * 301], [True, False]),
        ([*["AND X1", "OR X0"] * 400], [False, True]),
        ([*["LD X1", "OR X2", "ANB", "OR X0"] * 300], [False, True]),
        ([*["LD X1", "ANI X2", "ORB", "AND X0"] * 300], [False, True]),
        ([*["AND= K3 D0", "OR<> D0V0 K0"] * 300], [False, False]),
    ],
    ids=["INV", "AND OR", "ANB", "ORB", "comparisons"],
)
def test_long_rung(rung: list[str], powers: list[bool]) -> None:
    plc = plc_of(" / ".join(["LD X0", *rung, "OUT Y0"]))
    assert [bool(on(plc.scan(now_ms, levels(*x)))) for now_ms, x in ((0, ()), (10, (0,)))] == powers


def test_edges_occur_once_at_constant_time() -> None:
    plc = plc_of("LDP X0 / INC D0 / LD X0 / INCP D1")
    for _, x in pairwise((None, (), (0,), (0,), (), (0,))):
        plc.scan(0, levels(*(x or ())))
    assert plc.memory.D[:2] == [2, 2]
