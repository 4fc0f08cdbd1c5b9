"""IST (FNC 60): operating modes of a machine with a step ladder.

The switches and the roles of S0, S1, S2 are from a digest of the manuals; everything else is from memory
(docs/sources/fx2n.md 1.8).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from itertools import chain
from typing import Final

from controller.core.devices import Memory
from controller.fx.engine.access import Level, LevelFactory, bits, within
from controller.fx.engine.cpu import Cpu, OperationError
from controller.fx.language.instruction import DeviceOperand, Operand

TRANSFER_DISABLED, TRANSFER_START, START_PULSE = 8040, 8041, 8042
ZERO_RETURNED, OUTPUT_RESET_DISABLED, STL_MONITOR = 8043, 8045, 8047
ZERO_RETURN_STATES: Final = range(10, 20)
AUTOMATIC_STATES: Final = range(20, 900)
SWITCHES: Final = 8
AUTOMATIC: Final = 2
"""Number of the initial state of the modes stepping, one cycle and continuous."""


class IstMode(IntEnum):
    """Switch position; the value is the offset of its input from the first operand."""

    INDIVIDUAL = 0
    ZERO_RETURN = 1
    STEPPING = 2
    ONE_CYCLE = 3
    CONTINUOUS = 4

    @property
    def initial_state(self) -> int:
        """Initial state of the mode: S0, S1 or S2."""
        return min(self, AUTOMATIC)


@dataclass(frozen=True, slots=True)
class _Panel:
    """Current positions of the operator's switches and buttons."""

    mode: IstMode | None
    zero_return_start: bool
    start: bool
    stop: bool


def _panel(switches: list[bool]) -> _Panel:
    chosen = [mode for mode in IstMode if switches[mode]]
    # between two positions a rotary switch closes no contact or two contacts: the mode does not change yet
    return _Panel(chosen[0] if len(chosen) == 1 else None, *switches[5:SWITCHES])


class _Modes:
    """State of one IST instruction between scans."""

    def __init__(self, memory: Memory, automatic: range) -> None:
        self.memory = memory
        self.automatic = automatic
        self.mode: IstMode | None = None
        self.pressed = (False, False)
        self.stopped = False

    def step(self, panel: _Panel) -> None:
        special = self.memory.M
        special[STL_MONITOR] = True
        started, zero_return_started = self._edges(panel)
        if panel.mode is not None and panel.mode is not self.mode:
            self._change(panel.mode)
        special[START_PULSE] = started
        go = started or (zero_return_started and self.mode is IstMode.ZERO_RETURN)
        self.stopped = panel.stop or (self.stopped and not go)
        match self.mode:
            case None:
                return
            case IstMode.INDIVIDUAL:
                disabled, start = True, False
            case IstMode.ZERO_RETURN:
                disabled, start = self.stopped, False
            case IstMode.STEPPING:
                disabled, start = not started, panel.start
            case IstMode.ONE_CYCLE:
                disabled, start = self.stopped, panel.start
            case IstMode.CONTINUOUS:
                # stop lets the cycle finish: it clears transfer start but does not disable transfers
                disabled = special[TRANSFER_DISABLED] and not started
                start = (panel.start or special[TRANSFER_START]) and not panel.stop
        special[TRANSFER_DISABLED], special[TRANSFER_START] = disabled, start

    def _edges(self, panel: _Panel) -> tuple[bool, bool]:
        """Return the rising edges of start and zero return start; an active stop suppresses them."""
        now = (panel.start, panel.zero_return_start)
        started, zero_return_started = (on and not was for on, was in zip(now, self.pressed, strict=True))
        self.pressed = now
        return started and not panel.stop, zero_return_started and not panel.stop

    def _change(self, mode: IstMode) -> None:
        memory, before = self.memory, self.mode
        self.mode, self.stopped = mode, False
        memory.M[TRANSFER_START] = False
        # after RUN begins, a machine in continuous mode waits for its start button
        memory.M[TRANSFER_DISABLED] = mode is IstMode.CONTINUOUS and before is None
        if before is not None and before.initial_state == mode.initial_state:
            return
        if before is None and mode.initial_state == AUTOMATIC and any(memory.S[state] for state in self.automatic):
            # the sequence resumes from the latched states
            return
        for state in chain(range(3), ZERO_RETURN_STATES, self.automatic):
            memory.S[state] = False
        memory.S[mode.initial_state] = True
        if before is not None and not (memory.M[ZERO_RETURNED] or memory.M[OUTPUT_RESET_DISABLED]):
            memory.Y[:] = [False] * len(memory.Y)


def ist(cpu: Cpu, operands: tuple[Operand, ...], _wide: bool) -> Level:
    """IST s d1 d2: mode selection by the eight switches from s; d1 to d2 are the automatic states (in S20-S899).

    Switches: individual, zero return, stepping, one cycle, continuous, zero return start, start, stop. In every scan:

    * M8047 is on; M8042 is on for one scan when start is pressed. Start has no effect while stop is pressed.
    * M8040 (transfers disabled) is always on in individual mode. In zero return and one cycle modes, it is on from a
      stop until the next start; in stepping mode, in every scan except the one in which start is pressed; in continuous
      mode, from RUN until the first start. In zero return mode, the zero return start button also counts as a start.
    * M8041 (transfer start) is on in stepping and one cycle modes while the start button is pressed, and in continuous
      mode from a start until the next stop.
    * A change between the individual, zero return and automatic modes resets S0-S2, S10-S19 and d1-d2 and sets S0, S1
      or S2; all Y turn off unless M8043 (zero return complete) or M8045 is on. The first mode after RUN has the same
      effect, except on the outputs; if it is an automatic mode and a latched automatic state is on, the states do not
      change.
    * If no switch or more than one switch is on, the mode does not change.

    The program must drive M8043 and M8044. A start button that is on when RUN begins counts as a start.
    An instruction that is not driven has no effect.
    """
    cells, row = bits(cpu, operands[0])
    low, high = operands[1], operands[2]
    if not (isinstance(low, DeviceOperand) and isinstance(high, DeviceOperand)):
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


LEVELS: Final[dict[str, LevelFactory]] = {"IST": ist}
