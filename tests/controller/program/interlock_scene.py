"""Forbidden combinations of outputs, stated in terms of the machine and evaluated on the memory after a scan.

The positions of an arm are read from the terminals in the complete program, but from forced relays in tests of the
output block alone.
"""

from __future__ import annotations

from controller.core.expr import Bit, Word
from controller.core.scan import Plc
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.interlocks import BELT, CLAWS, LIFT, SLIDE
from controller.program.machine import build
from controller.program.operator.commands import ARM_OUTPUTS, JOGGED
from controller.program.tags import IN_PLACE, ROWS, SIDES, Side

MACHINE = build(load_io_map(DEFAULT_IO_MAP))
TAGS = MACHINE.tags
TRAY_OUTPUTS = ("tray_run", "tray_forward")
COILS = [*((side, output) for side in SIDES for output in ARM_OUTPUTS), *((None, output) for output in TRAY_OUTPUTS)]
PLACES = {
    side: {
        "lift_down": arm.down,
        "lift_up": arm.up,
        "slide_at_feed": arm.at_feed,
        "claws_spread": arm.is_spread,
        "claws_converged": arm.is_converged,
    }
    for side, arm in TAGS.arms.items()
}
"""Relays of the confirmed positions of each arm, by switch."""
SWITCHES = (
    ("lift_down", "lift_up"),
    ("claws_spread", "claws_converged"),
    ("slide_at_feed", *(f"slide_at_pick_{row}" for row in ROWS)),
)
"""Switches of each device; at most one of them is on at a time."""

Device = Bit | Word


def tag_of(side: Side | None, output: str) -> str:
    return f"{side}.{output}" if side else output


class Scene:
    """Memory after a scan.

    Attributes:
        on: Tags of the active outputs.
        sensed: Tags of the active inputs.
    """

    def __init__(self, plc: Plc) -> None:
        self._plc = plc
        memory, io_map = plc.memory, MACHINE.io_map
        self.on = {point.tag for point in io_map.outputs if point.active(memory.Y[point.number])}
        self.sensed = {point.tag for point in io_map.inputs if point.active(memory.X[point.number])}

    def has(self, device: Device) -> int:
        return self._plc.read(device)

    def places(self, side: Side) -> set[str]:
        """Return the names of the position switches of an arm that are on at the terminals."""
        return {name for name in PLACES[side] if f"{side}.{name}" in self.sensed}

    def is_jogged(self, output: str) -> bool:
        """Return True if an output is being jogged."""
        return self.has(TAGS.machine.jog) == 1 + JOGGED.index(output)


class BlockScene(Scene):
    """Memory of a PLC that runs only the output block; the relays of the confirmed positions are forced."""

    def places(self, side: Side) -> set[str]:
        return {name for name, place in PLACES[side].items() if self.has(place)}


def forbidden(scene: Scene) -> list[str]:
    """Return the forbidden combinations that are present."""
    found = [f"{side}: {text}" for side in SIDES for text, wrong in arm_forbidden(scene, side) if wrong]
    return found + [f"tray: {text}" for text, wrong in tray_forbidden(scene) if wrong]


def arm_forbidden(scene: Scene, side: Side) -> list[tuple[str, bool]]:
    arm = TAGS.arms[side]
    on = {output for output in ARM_OUTPUTS if f"{side}.{output}" in scene.on}
    place = scene.places(side)
    loaded, closed, clamped = (bool(scene.has(bit)) for bit in (arm.loaded, arm.claws_closed, arm.clamped))
    down, up, feed = ("lift_down" in place), ("lift_up" in place), ("slide_at_feed" in place)
    is_jogged = bool(scene.has(TAGS.machine.jogging))
    reached = {place for place in ("spread", "converged") if scene.has(arm.reached[place])}
    return [
        *((f"{one} against {two}", {one, two} <= on) for one, two in (SLIDE, LIFT, BELT, CLAWS)),
        ("in emergency stop", bool(on) and "emergency_stop" in scene.sensed),
        ("without permission to move", bool(on) and not scene.has(TAGS.machine.motion)),
        ("with a fault of the arm", bool(on) and bool(scene.has(arm.fault)) and not is_jogged),
        ("the arm moves with the belt", bool(on & {*SLIDE, *LIFT}) and bool(on & {*BELT})),
        *(inward_forbidden(scene, side) if "slide_inward" in on else ()),
        ("outward at mid-height", "slide_outward" in on and not up and not down),
        ("outward low, closed or loaded", "slide_outward" in on and not up and (closed or loaded)),
        ("up half closed", "lift_retract" in on and not feed and closed and not clamped),
        ("down away from feed", "lift_extend" in on and not feed and not putting_back(scene, side)),
        ("spread away from feed or not up", "spread" in on and not (up and feed)),
        ("converge away from feed or loaded", "converge" in on and (loaded or not feed)),
        ("spread against its end", "spread" in on and f"{side}.claws_spread" in scene.sensed and "spread" in reached),
        (
            "converge against its end",
            "converge" in on and f"{side}.claws_converged" in scene.sensed and "converged" in reached,
        ),
        (
            "close away from row and feed",
            "claws_close" in on and not feed and not (scene.has(arm.at_wanted_row) and down),
        ),
        *(opening_forbidden(scene, side) if "claws_open" in on and loaded else ()),
    ]


def putting_back(scene: Scene, side: Side) -> bool:
    """Return True if homing is lowering the arm to put the gripped row back in its place."""
    arm, home = TAGS.arms[side], MACHINE.homings[side]
    return bool(scene.has(home["lower to put back"]) and scene.has(arm.on_row) and scene.has(arm.at_wanted_row))


def inward_forbidden(scene: Scene, side: Side) -> list[tuple[str, bool]]:
    """Return each condition that is forbidden while the slide moves inward, and whether it is present."""
    arm, other, place = TAGS.arms[side], TAGS.other(side), scene.places(side)
    tray_in_place = scene.has(TAGS.tray.phase) == IN_PLACE and "tray_front_edge" in scene.sensed
    shares = bool(scene.has(arm.row_is[1]) or scene.has(TAGS.sp.arms_may_meet))
    both_at_row_2 = scene.has(arm.row_is[2]) and scene.has(other.row_is[2])
    return [
        ("inward, not down", "lift_down" not in place),
        ("inward, closed or loaded", bool(scene.has(arm.loaded) or scene.has(arm.claws_closed))),
        ("inward, not converged", "claws_converged" not in place),
        ("inward without a tray", not tray_in_place),
        ("inward over a tray about to move", tray_is_wanted(scene)),
        ("inward past the row", bool(scene.has(arm.passed))),
        ("inward without a wanted row", not any(scene.has(wanted) for wanted in arm.row_is.values())),
        ("inward into the other arm", not shares and not both_at_row_2 and bool(scene.has(other.in_centre))),
        (
            "inward with the other arm in an unknown place",
            not shares and "slide_at_feed" not in scene.places(other.side) and not scene.has(other.cycling),
        ),
    ]


def opening_forbidden(scene: Scene, side: Side) -> list[tuple[str, bool]]:
    """Return each condition that is forbidden while a loaded arm opens its claws, and whether it is present."""
    arm, cycle, home, place = TAGS.arms[side], MACHINE.cycles[side], MACHINE.homings[side], scene.places(side)
    is_jogged, feed = scene.is_jogged(f"{side}.claws_open"), "slide_at_feed" in place
    at_its_row = is_jogged and scene.has(arm.row_in_progress) and scene.has(arm.at_wanted_row)
    putting_back = at_its_row or (scene.has(home["put back"]) and not scene.has(arm.at_feed))
    throwing = (
        scene.has(cycle["open claws"]) or scene.has(home["open at feed"]) or (is_jogged and scene.has(arm.discard))
    )
    return [
        ("drop the load from above", "lift_down" not in place),
        ("drop the load between row and feed", not feed and not putting_back),
        ("drop the load beside the cups", feed and not putting_back and "claws_spread" not in place),
        ("drop the load without a request", feed and not putting_back and not throwing),
    ]


def tray_forbidden(scene: Scene) -> list[tuple[str, bool]]:
    on = bool(scene.on & {*TRAY_OUTPUTS})
    at_feed = all("slide_at_feed" in scene.places(side) for side in SIDES)
    entering = any(scene.has(arm.want["slide_inward"]) for arm in TAGS.arms.values())
    is_jogged = bool(scene.has(TAGS.machine.jogging))
    return [
        ("in emergency stop", on and "emergency_stop" in scene.sensed),
        ("without permission to move", on and not scene.has(TAGS.machine.motion)),
        ("with an arm away from feed", on and not at_feed),
        ("with an arm about to go in", on and entering),
        ("with a fault of the feeder", on and bool(scene.has(TAGS.tray.fault)) and not is_jogged),
        ("run without its direction", "tray_run" in scene.on and "tray_forward" not in scene.on),
    ]


def tray_is_wanted(scene: Scene) -> bool:
    return bool(scene.has(TAGS.tray.want_run) or scene.has(TAGS.tray.want_creep))
