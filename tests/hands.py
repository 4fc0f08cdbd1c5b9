"""An operator who works the machine by hand in manual mode, one output after another."""

from __future__ import annotations

from routes import run_row_1
from twin_rig import switched_on

from controller.program.states import Mode, State
from controller.program.tags import Side
from plant_sim.bench.twin import Twin

RENEWED_MS = 100
"""How often a hand that stays on the button renews its order."""


def change_mode(twin: Twin, mode: Mode) -> None:
    """Order another mode."""
    twin.command(f"mode_{mode.name.lower()}")
    twin.scan()
    assert twin.plc.read(twin.machine.tags.machine.mode) == mode


def stop(twin: Twin) -> None:
    """Press X24 and wait for Stopped."""
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=20_000)
    twin.run_for(200)


def to_manual(twin: Twin) -> None:
    """Go from Stopped to where outputs can be held by hand."""
    change_mode(twin, Mode.MANUAL)
    twin.home()
    twin.start()


def to_continuous(twin: Twin) -> None:
    """Go from manual mode to automatic work."""
    stop(twin)
    change_mode(twin, Mode.CONTINUOUS)
    twin.home()
    twin.start()


def by_hand(side: Side = "left") -> Twin:
    """Return a machine in manual mode, empty arms at home; row 1 of the side has been thrown."""
    twin = switched_on({"trays_target": 1})
    run_row_1(twin, side)
    stop(twin)
    to_manual(twin)
    return twin


def order(output: str) -> str:
    """Return the command that holds an output."""
    return f"jog_{output.replace('.', '_')}"


def jog(twin: Twin, output: str, for_ms: int) -> None:
    """Hold an output on for a time, then let it go."""
    for _ in range(for_ms // RENEWED_MS):
        twin.command(order(output))
        twin.run_for(RENEWED_MS)
    twin.command("jog_release")
    twin.scan()


def take_row(twin: Twin, side: Side) -> None:
    """Go in to the next row and close the claws."""
    jog(twin, f"{side}.slide_inward", 2_500)
    jog(twin, f"{side}.claws_close", 500)


def bring_to_feed(twin: Twin, side: Side) -> None:
    """Lift what the claws hold and go out with it."""
    jog(twin, f"{side}.lift_retract", 1_500)
    jog(twin, f"{side}.slide_outward", 2_500)


def refusing_rule(twin: Twin, side: Side) -> str | None:
    """Return the name of the interlock that refuses what is wanted of an arm."""
    number = twin.plc.read(twin.machine.tags.arms[side].blocked_by)
    return next((rule.name for rule in twin.machine.rules[side] if rule.number == number), None)
