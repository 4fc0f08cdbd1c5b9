"""Known causes of harm in random stories that have not been mended; a test checks that each is still needed."""

from __future__ import annotations

from typing import Final

from plant_sim.stories.drawn.verdict import KnownHarm

KNOWN: Final = (
    KnownHarm(
        "tray pushed by hand",
        "push",
        "",
        frozenset({"stems_cut", "lost", "torn", "arm_through_tray", "dropped", "gentle_inward"}),
        "the only tray sensor reports that a tray is there, not where its front edge is: a tray that is pushed by hand "
        "while the machine rests without an emergency stop, manual mode or loss of power, and that stays in the beam, "
        "is taken for the one in place, and the claws close beside its stems. A second sensor would tell it",
        "seed=541 trays=3 work=30540; 31100 press stop for=300; 45000 push =12.0; 50000 tend",
    ),
    KnownHarm(
        "tray sensor back over a creeping tray",
        "broken_wire",
        "tray_front_edge",
        frozenset({"stems_cut", "lost"}),
        "a tray sensor whose wire is mended while the feeder creeps, with a tray already in the beam, looks like its "
        "front edge: the tray stops 77 mm past its mark and is taken for one in place",
        "seed=671 trays=3 work=40890; 11270 fault doubled_pulses:left.cup_pulse =0.593 for=24210; "
        "12590 fault broken_wire:tray_front_edge; 22780 tend; 28110 tend; 33040 tend; 36710 tend; 44260 tend",
    ),
    KnownHarm(
        "single false cup pulse at standstill",
        "stuck_on",
        "cup_pulse",
        frozenset({"double", "lost"}),
        "a cup counter that comes on once while the tractor stands counts one cup too many; the time to the next cup "
        "tells nothing after a standstill, and the rows count alternately again. A ground sensor tells it (left row)",
        "seed=736 trays=3 work=40410; 34190 speed =0.0; 41220 fault stuck_on:left.cup_pulse",
    ),
)
