"""IST (FNC 60): operating modes of a machine in step ladder.

Switches and roles of S0, S1, S2 were seen in a digest; all the rest is general knowledge (GK), FX.md 1.8.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from itertools import chain
from typing import Final

from controller.core.devices import Memory
from controller.fx.access import Level, LevelMaker, bits, within
from controller.fx.cpu import Cpu, OperationError
from controller.fx.instruction import Device, Operand

TRANSFER_DISABLED, TRANSFER_START, START_PULSE = 8040, 8041, 8042
ZERO_RETURNED, OUTPUTS_KEPT, STL_MONITOR = 8043, 8045, 8047
ZERO_RETURN_STATES: Final = range(10, 20)
AUTOMATIC_STATES: Final = range(20, 900)
SWITCHES: Final = 8
AUTOMATIC: Final = 2
"""Number of the initial state of stepping, one cycle and continuous."""


class Mode(IntEnum):
    """The five switch positions, by their place from the first operand on."""

    INDIVIDUAL = 0
    ZERO_RETURN = 1
    STEPPING = 2
    ONE_CYCLE = 3
    CONTINUOUS = 4

    @property
    def initial_state(self) -> int:
        """The initial state that stands for it: S0, S1 or S2."""
        return min(self, AUTOMATIC)


@dataclass(frozen=True, slots=True)
class _Panel:
    """What the operator holds now."""

    mode: Mode | None
    zero_return_start: bool
    start: bool
    stop: bool


def _panel(switches: list[bool]) -> _Panel:
    chosen = [mode for mode in Mode if switches[mode]]
    # between two positions a rotary switch shows none or two: no new mode yet
    return _Panel(chosen[0] if len(chosen) == 1 else None, *switches[5:SWITCHES])


class _Modes:
    """State of one IST from scan to scan."""

    def __init__(self, memory: Memory, automatic: range) -> None:
        self.memory = memory
        self.automatic = automatic
        self.mode: Mode | None = None
        self.pressed = (False, False)
        self.stopped = False

    def step(self, panel: _Panel) -> None:
        special = self.memory.M
        special[STL_MONITOR] = True
        started, zero_return_started = self._edges(panel)
        if panel.mode is not None and panel.mode is not self.mode:
            self._change(panel.mode)
        special[START_PULSE] = started
        go = started or (zero_return_started and self.mode is Mode.ZERO_RETURN)
        self.stopped = panel.stop or (self.stopped and not go)
        match self.mode:
            case None:
                return
            case Mode.INDIVIDUAL:
                disabled, start = True, False
            case Mode.ZERO_RETURN:
                disabled, start = self.stopped, False
            case Mode.STEPPING:
                disabled, start = not started, panel.start
            case Mode.ONE_CYCLE:
                disabled, start = self.stopped, panel.start
            case Mode.CONTINUOUS:
                # a stop lets the cycle finish: it ends the start, not the transfers
                disabled = special[TRANSFER_DISABLED] and not started
                start = (panel.start or special[TRANSFER_START]) and not panel.stop
        special[TRANSFER_DISABLED], special[TRANSFER_START] = disabled, start

    def _edges(self, panel: _Panel) -> tuple[bool, bool]:
        """Return whether start and zero return start were pressed in this scan; a held stop outranks them."""
        now = (panel.start, panel.zero_return_start)
        started, zero_return_started = (on and not was for on, was in zip(now, self.pressed, strict=True))
        self.pressed = now
        return started and not panel.stop, zero_return_started and not panel.stop

    def _change(self, mode: Mode) -> None:
        memory, before = self.memory, self.mode
        self.mode, self.stopped = mode, False
        memory.M[TRANSFER_START] = False
        # after the start of RUN a continuous machine waits for its start button
        memory.M[TRANSFER_DISABLED] = mode is Mode.CONTINUOUS and before is None
        if before is not None and before.initial_state == mode.initial_state:
            return
        if before is None and mode.initial_state == AUTOMATIC and any(memory.S[state] for state in self.automatic):
            # latched states go on where they were
            return
        for state in chain(range(3), ZERO_RETURN_STATES, self.automatic):
            memory.S[state] = False
        memory.S[mode.initial_state] = True
        if before is not None and not (memory.M[ZERO_RETURNED] or memory.M[OUTPUTS_KEPT]):
            memory.Y[:] = [False] * len(memory.Y)


def ist(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Level:
    """IST s d1 d2: modes by the eight switches from s on; d1 to d2 are the automatic states (in S20-S899).

    Switches: individual, zero return, stepping, one cycle, continuous, zero return start, start, stop. Every scan:

    * M8047 is on; M8042 is on for one scan when start is pressed. Start has no effect while stop is held.
    * M8040, transfers disabled: individual: on. Zero return and one cycle: from stop to start. Stepping: on but for
      the scan of a start. Continuous: after RUN until start. In zero return its own start button counts too.
    * M8041, transfer start: stepping and one cycle: with the start button. Continuous: from start to stop.
    * A change between individual, zero return and automatic resets S0-S2, S10-S19 and d1-d2 and sets S0, S1 or S2;
      all Y go off unless M8043 (zero return complete) or M8045 is on. The first mode after RUN does the same but for
      the outputs; an automatic one leaves everything as it is if a latched automatic state is on.
    * With no or several switches on the mode stays.

    M8043 and M8044 are the program's. A start held when RUN begins is a start.
    While the instruction is not driven nothing changes.
    """
    cells, row = bits(cpu, operands[0])
    low, high = operands[1], operands[2]
    if not (isinstance(low, Device) and isinstance(high, Device)):
        raise TypeError(f"not states: {low} {high}")
    first, last = low.number, high.number
    modes = _Modes(cpu.memory, range(first, last + 1))

    def run(on: bool) -> None:
        if not on:
            return
        if first >= last:
            raise OperationError
        within(first, AUTOMATIC_STATES.start, AUTOMATIC_STATES.stop - 1)
        within(last, AUTOMATIC_STATES.start, AUTOMATIC_STATES.stop - 1)
        modes.step(_panel(cells[row(SWITCHES)]))

    return run


LEVELS: Final[dict[str, LevelMaker]] = {"IST": ist}
