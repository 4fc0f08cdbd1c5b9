"""Situations that the safety requirements forbid, each with the condition that decides it."""

from __future__ import annotations

from typing import NamedTuple

from controller.program.interlocks import BELT, CLAWS, LIFT, SLIDE
from controller.program.operator.commands import ARM_OUTPUTS, JOGGED
from controller.program.tags import ROWS, SIDES

PLACE_OF = {
    "lift_down": "down",
    "lift_up": "up",
    "slide_at_feed": "feed",
    **{f"slide_at_pick_{row}": f"pick {row}" for row in ROWS},
    "claws_spread": "spread",
    "claws_converged": "converged",
}
"""Place of each switch of an arm."""
MOVES = "lift_extend"
"""Arbitrary motion coil."""


class Case(NamedTuple):
    """Situation that a requirement forbids, and the condition whose inversion makes the situation permissible."""

    requirement: str
    on: str
    turned: str


OF_AN_ARM: dict[str, list[Case]] = {
    "never both coils of one valve or motor": [
        Case(f"{one} with {two}", f"{one} {two}", one) for one, two in (SLIDE, LIFT, BELT, CLAWS)
    ],
    "inward only down, open, converged, over a tray in place": [
        Case("inward, not down", "slide_inward lift_up", "lift_down"),
        Case("inward, claws not open", "slide_inward", "open"),
        Case("inward, not converged", "slide_inward claws_spread", "claws_converged"),
        Case("inward, no tray at rest", "slide_inward tray_in_place", "tray_front_edge"),
        Case("inward, no tray at rest", "slide_inward tray_front_edge", "tray_in_place"),
        Case("inward, tray unknown", "slide_inward tray_asked", "tray_asked"),
    ],
    "inward no further than the next row": [
        Case("inward, past the row", "slide_inward arrived", "arrived"),
        Case("inward, past the row", "slide_inward arrived", "slide_inward"),
    ],
    "claws close only at a valid row or at feed": [
        Case("close away from row and feed", "claws_close lift_down", "slide_at_feed"),
        Case("close away from row and feed", "claws_close lift_down", "slide_at_pick_1"),
        Case("close away from row and feed", "claws_close slide_at_pick_1", "lift_down"),
        Case("close away from row and feed", "claws_close lift_down slide_at_pick_2", "row_1_taken"),
        Case("close away from row and feed", "claws_close lift_down slide_at_pick_1 row_1_taken", "row_1_taken"),
    ],
    "the lift goes up over the tray only clamped for its dwell, or open": [
        Case("up, claws neither open nor clamped", "lift_retract", "gripped"),
        Case("up, claws neither open nor clamped", "lift_retract", "open"),
        Case("up, claws neither open nor clamped", "lift_retract", "slide_at_feed"),
    ],
    "a load goes out only up; an empty arm up, or low and open": [
        Case("outward with a load, not up", "slide_outward holds", "lift_up"),
        Case("outward with a load, not up", "slide_outward holds", "holds"),
        Case("outward, not up, claws not open", "slide_outward lift_down", "open"),
        Case("outward, not up, claws not open", "slide_outward open", "lift_down"),
        Case("outward, not up, claws not open", "slide_outward", "lift_up"),
    ],
    "down only at feed": [Case("down away from feed", "lift_extend", "slide_at_feed")],
    "a load goes down over the cups only when spread": [
        Case("down over the cups with a load, not spread", f"{MOVES} holds slide_at_feed", turned)
        for turned in (MOVES, "holds", "slide_at_feed", "claws_spread")
    ],
    "spread only up at feed": [
        Case("spread, not up at feed", "spread lift_up", "slide_at_feed"),
        Case("spread, not up at feed", "spread slide_at_feed", "lift_up"),
    ],
    "slide and lift are at rest while the belt runs": [
        Case("belt with slide or lift", f"{belt} {other}", turned)
        for belt, other, turned in (
            ("spread", "slide_inward", "slide_inward"),
            ("spread", "lift_retract", "spread"),
            ("converge", "slide_outward", "converge"),
            ("converge", "lift_extend", "lift_extend"),
        )
    ],
    "the belt stops at its ends": [
        Case("belt against its end stop", "spread claws_spread", "claws_spread"),
        Case("belt against its end stop", "converge claws_converged", "claws_converged"),
    ],
    "converge only empty, at feed": [
        Case("converge with a load", "converge holds slide_at_feed", "holds"),
        Case("converge away from feed", "converge", "slide_at_feed"),
    ],
    "a load opens only over its cups, at its row, or by a discard command": [
        *(
            Case(
                "load released away from its cups and row",
                " ".join(["claws_open holds", *(name for name in over_cups if name != missing)]),
                missing,
            )
            for over_cups in (
                ("slide_at_feed", "lift_down", "claws_spread", "released"),
                ("slide_at_feed", "lift_down", "claws_spread", "discarded"),
            )
            for missing in over_cups
        ),
        Case("load released away from its cups and row", "claws_open holds lift_down", "unmoved"),
        Case("load released away from its cups and row", "claws_open holds unmoved", "lift_down"),
        Case("load released away from its cups and row", "claws_open holds", "holds"),
    ],
    "never both arms in one space": [
        Case("inward, other arm in the centre", "slide_inward rows_1_and_2_taken other_in_centre", "other_in_centre"),
        Case("inward, other arm in the centre", "slide_inward rows_1_and_2_taken other_in_centre", "arms_may_meet"),
    ],
    "a jammed actuator is driven only in manual mode": [
        Case("coil on during a fault", "fault claws_open", "fault"),
        Case("coil on during a fault", "fault claws_open", "manual"),
    ],
    "each release is one cycle, and no row changes without a reason": [
        Case("a release not counted once", "miscounted", "miscounted"),
        Case("a row changed without its reason", "row_changed", "row_changed"),
    ],
    "an arm out of service is never driven, in no mode": [
        *(
            Case("coil on while out of service", f"out_of_service manual {coil}", "out_of_service")
            for coil in ARM_OUTPUTS
        ),
        Case("coil on while out of service", "out_of_service claws_close", "claws_close"),
    ],
}
OF_THE_MACHINE: dict[str, list[Case]] = {
    "the tray moves only with both arms at feed, and none goes in over it": [
        *(
            Case("tray moves with an arm away from feed", f"{coil} {at_feed}.slide_at_feed", f"{away}.slide_at_feed")
            for coil in ("tray_run", "tray_forward")
            for at_feed, away in (SIDES, SIDES[::-1])
        ),
        *(Case("tray moves while an arm moves in", f"tray_run {side}.slide_inward", "tray_run") for side in SIDES),
        Case("tray moves in the wrong direction", "tray_run", "tray_forward"),
        Case("tray moves during a fault", "tray_forward tray_fault", "tray_fault"),
        Case("tray moves during a fault", "tray_forward tray_fault", "manual"),
    ],
    "no arm goes in over a tray that may have been moved by hand": [
        *(
            Case("inward, tray perhaps moved", f"{side}.slide_inward", turned)
            for side in SIDES
            for turned in ("tray_fed", "manual", f"{side}.slide_inward")
        ),
    ],
    "nothing moves in an emergency stop": [
        Case("motion during an emergency stop", f"emergency_stop motion left.{MOVES}", "emergency_stop"),
        Case("motion during an emergency stop", "emergency_stop motion tray_run", "tray_run"),
    ],
    "no motion without inputs or after a fault": [
        Case("motion without inputs", f"link_lost motion right.{MOVES}", "link_lost"),
        Case("motion after a scan or store fault", f"scan_fault motion left.{MOVES}", "scan_fault"),
        Case("motion without outputs", f"outputs_taken motion left.{MOVES}", "outputs_taken"),
        Case("motion after a scan or store fault", f"store_fault motion left.{MOVES}", "store_fault"),
    ],
    "nothing restarts by itself: after reset, power or link return": [
        Case("motion in a state that does not allow it", f"left.{MOVES}", "motion"),
        Case("motion in the first scan", f"first_scan motion left.{MOVES}", "first_scan"),
        Case("restart without a command", "restarted", "restarted"),
    ],
    "an emergency stop is ended only by a person": [
        Case("clearing without the end of a press or a command", "cleared_unbidden", "cleared_unbidden"),
    ],
    "constants that differ are confirmed before the first homing": [
        *(
            Case("homing before the constants are confirmed", f"{mode} unconfirmed entered_resetting", "unconfirmed")
            for mode in ("", "manual")
        ),
        Case("homing before the constants are confirmed", "unconfirmed entered_resetting", "entered_resetting"),
    ],
    "no line names a key that is refused": [
        Case("a refused key named", "stopped names_home stop", "stop"),
        Case("a refused key named", "stopped names_home constants_open", "constants_open"),
        Case("a refused key named", "stopped names_home stop", "names_home"),
        Case("a refused key named", "stopped names_home stop", "refused_now"),
        *(
            Case("a refused key named", "stopped names_full_tray tray_asked tray_front_edge motion", turned)
            for turned in ("tray_asked", "motion", "stopped")
        ),
    ],
    "one arm at least is in service": [
        Case("both arms out of service", "left.out_of_service right.out_of_service", f"{side}.out_of_service")
        for side in SIDES
    ],
    "jogging only while the command is renewed": [
        Case("jog without renewal", f"manual motion left.{MOVES}", "jog"),
        Case("jog without renewal", f"manual motion left.{MOVES} jog jog_lease_over", "jog_lease_over"),
        Case("jog without command", "jog_unbidden", "jog_unbidden"),
    ],
    "in manual mode, only the output of the last jog command": [
        Case("another output than the jogged one", f"manual {JOGGED[0]}", "jog"),
        Case("another output than the jogged one", f"manual {JOGGED[0]}", "manual"),
        Case("another output than the jogged one", f"manual jog {JOGGED[0]} {JOGGED[1]}", JOGGED[1]),
        Case("another output than the jogged one", "manual jog tray_forward", "tray_forward"),
    ],
    "no tray leaves with full rows unless a person orders it, or an arm is out of service": [
        *(
            Case("full rows leave without an order", "tray_leaves tray_moving_out", turned)
            for turned in ("tray_leaves", "tray_moving_out", "empties_the_line")
        ),
        Case(
            "full rows leave without an order",
            "tray_leaves tray_moving_out left.out_of_service",
            "right.out_of_service",
        ),
    ],
    "only unknown memory is declared new, at rest, and no tray is in use then": [
        Case("declared new with memory", "declared_with_memory", "declared_with_memory"),
        Case("declared new in motion", "declared_in_motion", "declared_in_motion"),
        Case("declared new, and a tray in use", "declared_in_use", "declared_in_use"),
    ],
    "an elapsed time limit has its alarm": [
        Case("a time limit elapsed without its alarm", "approaches limit_elapsed", turned)
        for turned in ("approaches", "limit_elapsed", "limit_alarm")
    ],
}
