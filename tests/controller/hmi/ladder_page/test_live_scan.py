"""Scans of live programs, recomputed from what a client can read, compared with the scans as they were executed."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from typing import ClassVar

import pytest
from hypothesis import given, settings

from controller.core.devices import INITIAL_PULSE, Memory
from controller.core.program import Program
from controller.core.scan import Execution, Plc
from controller.export.instruction_list import SCRATCH, program_ladder
from controller.fx.engine.plc import FxPlc
from controller.fx.language.cpu_model import FX3U
from controller.fx.language.il import read_il
from controller.fx.observation.observation import ScanObservation
from controller.fx.observation.observed_plc import ObservedPlc
from controller.hmi.ladder_page.live_scan import LiveScan, LiveScanObserver
from controller.hmi.modbus.held_scan import HeldScan
from controller.hmi.serving.snapshot import HELD_SCANS, Snapshot, snapshot_of
from controller.program.states import State
from plant_sim.faults import parse_fault
from plant_sim.twin import lock_step as twin_module
from plant_sim.twin.lock_step import Twin
from tests.controller.export.test_program_ladder import rows_of
from tests.controller.fx.engine import test_executions as arbitrary
from tests.controller.program.interlock_scene import MACHINE
from tests.sampling import first_of

LADDER = program_ladder(MACHINE.program)
SCRATCH_WORDS = [("D", number) for number in SCRATCH]
FAULTS = ("stuck_off:left.lift_down@14s..17s", "broken_wire:right.slide_at_feed@23s..24s", "jammed:right.lift@26s..30s")


def held_of(snapshot: Snapshot, observer: LiveScanObserver) -> HeldScan:
    """Return what a client reads of a snapshot: the devices that an observer needs; all others are off or 0."""
    memory = Memory()
    for kind, number in observer.devices:
        if kind in "XYMSTC":
            memory.bits(kind)[number] = snapshot.bits[kind][number]
        if kind in "DTC":
            memory.set_word(kind, number, snapshot.words[{"D": "D", "T": "TN", "C": "CN"}[kind]][number])
    return HeldScan(snapshot.scans, snapshot.at_ms, memory)


def differences(seen: LiveScan, truth: ScanObservation) -> list[str]:
    """Return the devices and the instructions that differ from a scan as it was executed, and what is hidden."""
    assert seen.executed is not None
    return [*seen.differing, *seen.hidden, *wrong(seen.executed, truth)]


def wrong(executed: ScanObservation, truth: ScanObservation) -> list[str]:
    """Return the values of instructions that differ from a scan as it was executed."""
    found: list[str] = []
    for name in ("executed", "contacts", "powers", "coils"):
        rows = zip(getattr(executed, name), getattr(truth, name), strict=True)
        found += [f"{name}[{at}]" for at, (one, other) in enumerate(rows) if one != other]
    return found


class ReadPlc(Plc):
    """Soft PLC that a client reads in each scan, beside an observer with its complete memory.

    Attributes:
        found: Scans with differences, across all instances.
        compared: Number of scans, across all instances.
        every: Number of scans, at the end of which `HELD_SCANS` scans are compared.
    """

    found: ClassVar[list[tuple[int, list[str]]]] = []
    compared: ClassVar[int] = 0
    observer: ClassVar[ObservedPlc]
    reader: ClassVar[LiveScanObserver]
    every: ClassVar[int]

    def __init__(self, program: Program, *, input_filter_ms: int = 10, execution: Execution | None = None) -> None:
        super().__init__(program, input_filter_ms=input_filter_ms, execution=execution)
        self._activity: list[bool] | None = None
        self._held: deque[HeldScan] = deque(maxlen=HELD_SCANS)

    def scan(self, now_ms: int, levels: Sequence[bool]) -> list[bool]:
        nth = self.scans % self.every
        if nth < self.every - HELD_SCANS and self.scans > HELD_SCANS:
            return super().scan(now_ms, levels)
        before, first = rows_of(self.memory), self.scans == 0
        outputs = super().scan(now_ms, list(levels))
        held = held_of(snapshot_of(self.memory, now_ms, self.scans), self.reader)
        none_active = [False] * len(self.observer.execution.activity)
        self.observer.load(Memory(**before), none_active if first else self._activity, first=first)
        self.observer.scan(now_ms, list(self.memory.X))
        self._activity = list(self.observer.execution.activity)
        if self._held and self._held[0].number != held.number - 1:
            self._held.clear()
        self._held.appendleft(held)
        if len(self._held) == HELD_SCANS or self.scans < HELD_SCANS:
            ReadPlc.compared += 1
            found = differences(self.reader.observe(tuple(self._held)), self.observer.observation)
            if found:
                self.found.append((self.scans, found))
        return outputs


@pytest.mark.parametrize("every", first_of([120, 40]))
def test_every_scan_of_a_run_with_faults_is_that_of_the_controller(every: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each 120 scans, and every night of each 40, the last ones are compared."""
    monkeypatch.setattr(ReadPlc, "every", every, raising=False)
    monkeypatch.setattr(twin_module, "Plc", ReadPlc)
    monkeypatch.setattr(ReadPlc, "observer", ObservedPlc(LADDER, input_filter_ms=0), raising=False)
    monkeypatch.setattr(ReadPlc, "reader", LiveScanObserver(LADDER, SCRATCH_WORDS), raising=False)
    monkeypatch.setattr(ReadPlc, "found", [])
    twin = Twin(seed=1, trays=1, machine=MACHINE, faults=map(parse_fault, FAULTS))
    twin.home()
    twin.start()
    for _ in range(20):
        twin.run_for(1_000)
        if twin.state == State.HELD:
            twin.press("start", 1_000)
    assert not ReadPlc.found


class Tally(Counter[str]):
    """Numbers of scans that are shown as executed (equal), are not shown (told), or are shown otherwise (wrong)."""

    def add_program(self, text: str, story: list[arbitrary.FxScan]) -> None:
        """Add the scans of a program until it stops."""
        ladder = read_il(text, cpu=FX3U)
        live, observer = ObservedPlc(ladder, input_filter_ms=0), LiveScanObserver(ladder)
        held: deque[HeldScan] = deque(maxlen=HELD_SCANS)
        now_ms = 0
        for scanned in story:
            now_ms += scanned.pause_ms
            live.scan(now_ms, scanned.levels)
            if not live.running:
                return
            held.appendleft(held_of(snapshot_of(live.memory, now_ms, live.scans), observer))
            if len(held) == HELD_SCANS or live.scans == len(held):
                known = observer.observe(held).known
                self["told" if known is None else "wrong" if wrong(known, live.observation) else "equal"] += 1


def rung_with(text: str) -> str:
    """Return a rung with a comparison, an output or a loop."""
    if text.startswith("FOR"):
        return f"{text}\nNEXT"
    return f"LD X0\n{text}" if text in arbitrary.OUTPUTS else f"LD{text}\nOUT Y0"


UNREADABLE = (
    *("> D0V0 K0", "<= Z0 K1", "D< D0Z0 D2", "FOR D0V0", "RST Z0", "RST V0", "MOV D0V0 D4", "MOV K5 Z0", "MOVP D0 V0"),
    *("INC D4Z0", "DECP Z0", "ANS T10 K1 S900", "ANS T11 D0 S901", "STMR T12 K2 M20", "TTMR D6 K1"),
    *("RAMP D0 D1 D20 K3", "PLSY K200 K5 Y0", "PWM K20 K50 Y1", "INCD D0 C10 M30 K2", "ABSD D0 C0 M34 K2", "REF Y0 K8"),
    *("REFF K5", "PID D0 D1 D50 D2", "RS D0 K2 D30 K4", "MTR X0 Y20 M50 K2", "SPD X0 K20 D40", "FROM K0 K0 D0 K2"),
    *("TO K0 K0 D0 K2", "OUT C235 K2", "OUT C246 K-2", "RST C235", "DHSCS K2 C235 Y2", "DHSCR K1 C246 C246"),
    "DHSZ K0 K1 C235 M60",
)
"""Comparisons, outputs and loops of arbitrary programs with a state that no client can read."""


UNCLEAR_TIMERS = ("OUT T0 D0", "MOV D0 T0")
"""Outputs that make the start of a timer unknown in arbitrary programs, which drive and reset it elsewhere too."""


@pytest.mark.parametrize(
    ("programs", "excluded", "least_equal"),
    first_of(
        [
            (10, (*UNREADABLE, *UNCLEAR_TIMERS), 0.75),
            (600, (*UNREADABLE, *UNCLEAR_TIMERS), 0.75),
            (600, UNREADABLE, 0.7),
        ],
        1,
    ),
    ids=["10", "600", "600 with unclear timers"],
)
def test_scans_of_arbitrary_programs_are_shown_as_executed_or_not_at_all(
    programs: int, excluded: tuple[str, ...], least_equal: float
) -> None:
    tally = Tally()
    story = settings(max_examples=programs, derandomize=True, database=None)(
        given(arbitrary.programs(lambda text: text not in excluded), arbitrary.STORIES)(tally.add_program)
    )
    story()
    assert tally.total() > 4 * programs
    assert tally["equal"] > least_equal * tally.total()
    assert tally["wrong"] == 0


@pytest.mark.parametrize("text", UNREADABLE)
def test_a_program_with_a_state_that_no_client_can_read_is_not_shown_as_executed(text: str) -> None:
    lines = rung_with(text).splitlines()
    seen = observed("\n".join([*lines, "END"]), (0, [False], ()), (10, [False], ()), (20, [False], ()))
    assert [each.rpartition(" ")[0] for each in seen.hidden] == [line for line in lines if text in line]
    assert seen.known is None


def observed(text: str, *scans: tuple[int, Sequence[bool], Sequence[tuple[str, int]]]) -> LiveScan:
    """Run a program and observe its last scan; before each one, bits are inverted from outside."""
    ladder = read_il(text)
    plc, observer = FxPlc(ladder, input_filter_ms=0), LiveScanObserver(ladder)
    held: deque[HeldScan] = deque(maxlen=HELD_SCANS)
    for at_ms, levels, inverted in scans:
        for kind, number in inverted:
            bits = plc.memory.bits(kind)
            bits[number] = not bits[number]
        plc.scan(at_ms, levels)
        held.appendleft(held_of(snapshot_of(plc.memory, at_ms, plc.scans), observer))
    return observer.observe(held)


def test_a_device_that_was_written_from_outside_and_by_the_program_is_told() -> None:
    text = "LD X0\nSET M0\nLD M0\nOUT Y0\nEND"
    undisturbed = (0, [False], ()), (10, [False], ()), (20, [False], ())
    assert observed(text, *undisturbed).differing == ()
    assert observed(text, *undisturbed[:2], (20, [False], [("M", 0)])).differing == ("M0", "Y0")


def test_a_device_that_only_others_write_has_its_value_of_the_scan() -> None:
    seen = observed("LDP M5\nOUT Y0\nEND", (0, [], []), (10, [], []), (20, [], []), (30, [], [("M", 5)]))
    assert seen.executed is not None
    assert (seen.differing, seen.executed.contacts[0], seen.executed.coils[1]) == ((), True, True)
    assert seen.end.contacts[0] is None, "END values do not tell pulses"


def test_a_special_relay_has_its_value_from_before_the_held_scans() -> None:
    seen = observed("LD M8200\nOUT Y0\nEND", (0, [], [("M", 8200)]), *((at_ms, [], []) for at_ms in (10, 20, 30, 40)))
    assert seen.known is not None
    assert seen.known.coils[1] is True


def test_too_few_scans_show_end_values_only() -> None:
    ladder = read_il("LD X0\nOUT Y0\nEND")
    plc, observer = FxPlc(ladder, input_filter_ms=0), LiveScanObserver(ladder)
    plc.scan(0, [True])
    plc.scan(10, [True])
    seen = observer.observe([held_of(snapshot_of(plc.memory, 10, 2), observer)])
    assert (seen.executed, seen.end.coils[1]) == (None, True)


def test_a_scan_that_ends_with_an_error_is_not_shown_as_executed() -> None:
    """The watchdog time of the controller is not read; a loop that takes longer than the usual one is not repeated."""
    text = "LD X0\nOUT Y0\nP0\nLD M8000\nCJ P0\nEND"
    ladder = read_il(text)
    observer = LiveScanObserver(ladder)
    memory = Memory()
    memory.M[INITIAL_PULSE] = True
    seen = observer.observe([HeldScan(1, 0, memory)])
    assert seen.executed is None
    assert observer.observe([HeldScan(1, 0, memory)]).executed is None


@pytest.mark.parametrize(
    "rung",
    [
        *("LDP X1\nOUT Y0", "LDF X1\nOUT Y0", "LD X1\nORP X2\nOUT Y0", "LD X1\nPLS M0", "LD X1\nPLF M0"),
        *(
            "LD X1\nINCP D0",
            "LD X1\nOUT C0 K3",
            "LD X1\nOUT T250 K9",
            "LD X1\nOUT T0 K9\nLD X1\nRST T0",
            "STL S20\nOUT Y0\nRET",
        ),
    ],
)
def test_a_level_from_before_a_jump_is_not_shown_as_executed(rung: str) -> None:
    """No client can read the level that was stored when the instruction was executed last, before the jumped scans."""
    text = f"LD X0\nCJ P0\n{rung}\nP0\nEND"
    executed, jumped = [False, True], [True, True]
    scans = [(at_ms, levels, ()) for at_ms, levels in enumerate((executed, executed, jumped, jumped, executed))]
    seen = [observed(text, *scans[:count]) for count in range(3, 6)]
    assert [len(each.hidden) for each in seen] == [0, 0, 1]
    assert [each.known is None for each in seen] == [False, False, True]
    assert seen[-1].hidden[0].rpartition(" ")[0] in rung.splitlines()


TIMER = "LD X0\nOUT T0 {}\nLD T0\nOUT Y0"
AGAIN = "LD M8002\nRST T0"


@pytest.mark.parametrize(
    ("text", "is_hidden"),
    [
        (f"{TIMER.format('K5')}\n{AGAIN}", False),
        (TIMER.format("D0"), False),
        (f"{TIMER.format('D0')}\n{AGAIN}", True),
        (f"{TIMER.format('D0')}\nLD X1\nZRST T0 T3", True),
        (f"{TIMER.format('D0')}\nLD X1\nZRST T1 T3", False),
        (f"{TIMER.format('K5')}\nLD X1\nMOV D0 T0", True),
        (f"{TIMER.format('K5')}\nLD X1\nFMOV K0 T0 K2", True),
        (f"{TIMER.format('K5')}\nLD X1\nMOV T0 D0", False),
        (f"{TIMER.format('K5')}\nLD X1\nOUT T0 K9", True),
        (f"{TIMER.format('K5')}\nLD X1\nOUT T0 K5", False),
        (f"FOR K2\n{TIMER.format('D0')}\nNEXT", True),
        (f"FOR K2\nNEXT\n{TIMER.format('D0')}", False),
        (f"P0\n{TIMER.format('D0')}\nLD X1\nCJ P0", True),
        (f"LD X1\nCJ P0\nP0\n{TIMER.format('D0')}", False),
        (f"LD X1\nCALL P0\nFEND\nP0\n{TIMER.format('D0')}\nSRET", True),
        ("LD X0\nOUT T250 D0\nLD X1\nMOV D0 T250", False),
        ("LD X1\nMOV D0 T0\nLD> T0 K2\nOUT Y0", False),
    ],
)
def test_a_timer_whose_value_does_not_tell_its_start_is_named(text: str, is_hidden: bool) -> None:
    seen = observed(f"{text}\nEND", *((at_ms, [False, False], ()) for at_ms in range(6)))
    assert {each.rpartition(" ")[0].rpartition(" ")[0] for each in seen.hidden} == ({"OUT T0"} if is_hidden else set())


def test_a_scan_is_not_shown_with_a_timer_that_seems_to_run_because_of_a_write() -> None:
    """At END nothing differs: RST hides that the stopped timer began at 0 and not at the value written to it."""
    text = "LD M8002\nMOV K50 T0\nLD X0\nOUT T0 K10\nLD T0\nOUT M0\nLD X0\nRST T0\nEND"
    seen = observed(text, *((at_ms, [at_ms == 20], ()) for at_ms in (0, 10, 20)))
    assert seen.differing == ()
    assert seen.known is None


def test_in_a_rung_without_jumps_and_from_the_first_scan_on_each_level_is_known() -> None:
    pulse = "LDP X1\nOUT Y0\nLD X1\nOUT C0 K3\nEND"
    scans = [(at_ms, [False, bool(at_ms % 2)], ()) for at_ms in range(6)]
    assert [observed(pulse, *scans[:count]).hidden for count in range(3, 7)] == [()] * 4
    jumped = "LD X0\nCJ P0\nLDP X1\nOUT Y0\nP0\nEND"
    assert observed(jumped, (0, [True, True], ()), (1, [False, True], ())).hidden == ()
