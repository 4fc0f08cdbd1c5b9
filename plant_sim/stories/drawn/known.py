"""Known causes of harm in random stories that have not been mended; a test checks that each is still needed."""

from __future__ import annotations

from typing import Final

from plant_sim.stories.drawn.harm import NOT_RECOVERED
from plant_sim.stories.drawn.verdict import KnownHarm

KNOWN: Final = (
    KnownHarm(
        "tray pushed by hand",
        "push",
        frozenset({"stems_cut", "lost", "torn", "arm_through_tray", "dropped", "gentle_inward"}),
        "the only tray sensor reports that a tray is there, not where its front edge is: a tray that is pushed by hand "
        "at rest and stays in the beam is taken for the one in place, and the claws close beside its stems. A question "
        "after every emergency stop, or a second sensor, would tell it",
        "seed=541 trays=3 work=30540; 31100 press emergency_stop for=530; 31570 push =19.6",
    ),
    KnownHarm(
        "cup flags halved",
        "halved_flags",
        frozenset({"double", "lost"}),
        "flags that follow each other like those of a faster chain let a row fall a cup too early while the counts of "
        "both rows still agree, and a plug falls into a full cup; where the plugs land is not measured",
        "seed=613 trays=3 work=39830; 40690 press stop for=2300; "
        "42150 fault halved_flags:right.cup_pulse =0.733 for=3010",
    ),
    KnownHarm(
        "cup pulses doubled",
        "doubled_pulses",
        frozenset({"double", "lost"}),
        "as for halved flags: a row falls a cup too early after a stop, and plugs fall into full cups",
        "seed=1 trays=2 work=9000; 10000 fault doubled_pulses:left.cup_pulse =0.75 for=8400; 10030 command stop",
    ),
    KnownHarm(
        "stop in the scan of a cup alarm",
        "doubled_pulses",
        frozenset({NOT_RECOVERED}),
        "a stop within three scans of the alarms of the cup pulses leads to Stopping, where both arms wait for cups "
        "for ever: the alarms block the releases and can be reset only at rest, and no line says what to do. "
        "Abort, or the emergency stop, is the only way out",
        "seed=755 trays=3 work=0; 11910 tend; 26470 tend; "
        "26780 fault doubled_pulses:left.cup_pulse =0.75 for=18400; 26810 command stop",
    ),
    KnownHarm(
        "tray sensor back over a creeping tray",
        "broken_wire",
        frozenset({"stems_cut", "lost"}),
        "a tray sensor whose wire is mended while the feeder creeps, with a tray already in the beam, looks like its "
        "front edge: the tray stops 77 mm past its mark and is taken for one in place",
        "seed=671 trays=3 work=40890; 11270 fault doubled_pulses:left.cup_pulse =0.593 for=24210; "
        "12590 fault broken_wire:tray_front_edge; 22780 tend; 28110 tend; 33040 tend; 36710 tend; 44260 tend",
    ),
)
