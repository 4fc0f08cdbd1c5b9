"""Start warning: the horn, if wired, sounds in pulses before the first motion of homing, start and resume.

An accepted order waits for the end of the warning and lapses as soon as something obstructs it, or on any stop. The
automatic resume after Suspended is announced in the same way. Jogs and the steps of step mode need no warning: each has
a press of its own, so that orders in manual mode act at once. Without the horn, every order acts at once.
"""

from __future__ import annotations

from typing import Final

from controller.core.devices import CLOCK_1_S, MS_100
from controller.core.expr import Bit, Expr, all_of, any_of
from controller.core.rungs import OnDelay, Out, Rst, Rung, Set, ZoneReset
from controller.program.operator.refusals import Orders
from controller.program.states import State
from controller.program.tags import MachineTags, Tags

WARNING_MS: Final = 2_100
"""Duration of the warning, ms: 2 s, and one count of its timer, which may end sooner by that."""
FIRST_PULSE_MS: Final = 500
"""Duration for which the horn sounds at the begin of a warning, ms; the pulses of the clock follow."""
LAPSE_MS: Final = 10_000
"""Time after the warning in which something must move, ms; otherwise a new order is required."""


def warning_ms(tags: Tags) -> int:
    """Return the duration of the start warning, ms; 0 without the horn."""
    return WARNING_MS if tags.warns else 0


def request_rungs(tags: Tags, orders: Orders) -> list[Rung]:
    """Return the rungs that turn accepted orders into requests, with the horn after the warning."""
    machine, commands = tags.machine, tags.commands
    home, go = machine.home_waits, machine.go_waits
    if not tags.warns:
        return [
            Out(machine.home_requested, when=orders.accepted(commands.reset)),
            Out(machine.start_requested, when=orders.accepted(commands.start)),
            Out(machine.unhold_requested, when=orders.accepted(commands.unhold)),
        ]

    def stands(waits: Bit, command: Bit) -> Expr:
        return (orders.pressed.get(command, command) | waits) & orders.free(command)

    stopped = commands.stop | commands.hold
    held, suspended = (machine.state.equals(state) for state in (State.HELD, State.SUSPENDED))
    resumes = suspended & ~machine.suspend
    return [
        Out(home, when=stands(home, commands.reset) & ~stopped),
        Out(go, when=all_of(stands(go, commands.start) | stands(go, commands.unhold), ~stopped, ~home)),
        Out(machine.warning, when=any_of(home, go, resumes) & ~machine.manual),
        OnDelay(machine.t_warning, WARNING_MS, when=machine.warning),
        Out(machine.warned, when=machine.t_warning.done | machine.manual),
        Out(machine.home_requested, when=home & machine.warned),
        Out(machine.start_requested, when=all_of(go, machine.warned, ~held)),
        Out(machine.unhold_requested, when=all_of(go, machine.warned, held)),
        Rst(go, when=machine.warned),
    ]


def cancel_rungs(tags: Tags) -> list[Rung]:
    """Return the rung that ends an order when the panel is lost that may have given it."""
    machine = tags.machine
    return [ZoneReset(machine.home_waits, machine.go_waits, when=machine.panel_lost)] if tags.warns else []


def lapse_rungs(tags: Tags) -> list[Rung]:
    """Return the rungs of an order after which nothing moves; they follow the relay of motion."""
    machine, unmoved = tags.machine, tags.machine.unmoved
    if not tags.warns:
        return []
    ordered = any_of(machine.home_requested, machine.start_requested, machine.unhold_requested)
    excluded = any_of(~machine.motion, machine.manual, machine.stepping, machine.stands)
    return [
        Out(machine.stands, when=machine.state.equals(State.SUSPENDED)),
        Set(unmoved, when=ordered | machine.state.equals(State.UNSUSPENDING)),
        Rst(unmoved, when=any_of(excluded, *tags.moving.values())),
        OnDelay(machine.t_lapse, LAPSE_MS, when=unmoved),
        Set(machine.lapsed, when=machine.t_lapse.done & machine.executing),
        Rst(machine.lapsed, when=machine.resetting | machine.state.equals(State.UNHOLDING)),
    ]


def horn(machine: MachineTags, *, warns: bool) -> Expr:
    """Return the condition of the horn: steady for an alarm, in pulses for a warning, which has priority."""
    if not warns:
        return machine.horn
    clock = Bit("M", CLOCK_1_S, "1 s clock", "on for the first half of every second")
    pulses = clock | (machine.t_warning.value < FIRST_PULSE_MS // MS_100)
    return (machine.warning & pulses) | (machine.horn & ~machine.warning)
