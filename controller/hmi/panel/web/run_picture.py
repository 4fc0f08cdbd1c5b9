"""Machine of a recorded run in the form in which the mimic of the panel shows it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from controller.core.devices import Memory
from controller.hmi.panel.view.describe import describe
from controller.hmi.panel.view.facts import Json, MachineFacts
from controller.hmi.panel.web.app import STATIC
from controller.program.machine import Transplanter
from controller.program.tags import SIDES

_UNACKNOWLEDGED: Final = 1
"""State of an alarm that is on, as in the alarm list."""


class PanelPicture:
    """Picture of a machine that the commands of the debugger move.

    Attributes:
        files: Folder of the modules and styles of the panel.
    """

    files: Path = STATIC

    def __init__(
        self,
        machine: Transplanter,
        memory: Callable[[], Memory],
        telemetry: Callable[[], Mapping[str, float | None]],
        crop: Callable[[], Json] | None = None,
    ) -> None:
        """Take the sources of a picture, which are read in the present state of the run.

        Args:
            machine: The program of the machine and its tags.
            memory: Function that returns the devices of the program that has run.
            telemetry: Function that returns positions and counts of the plant by name.
            crop: Function that returns the facts about trays, rows and claws as the plant has them, for a program whose
                devices have another meaning; None = they are those that the machine's program has.
        """
        self._machine = machine
        self._facts = MachineFacts(machine)
        self._memory, self._telemetry, self._crop = memory, telemetry, crop

    def description(self) -> Json:
        """Return texts, dimensions and terminals, as the panel gets them."""
        return describe(self._machine, None)

    def view(self) -> Json:
        """Return the machine in the present state of the run: the sections of the panel's view that a mimic needs."""
        memory = self._memory()
        return {
            "link": {"telemetry": True},
            "io": self._facts.io(memory),
            "telemetry": dict(self._telemetry()),
            "counts": self._crop is None,
            **(
                self._of_program(memory)
                if self._crop is None
                else {"state": None, "alarms": {"rows": []}, **self._crop()}
            ),
        }

    def _of_program(self, memory: Memory) -> Json:
        alarms = [alarm.bit.number for alarm in self._machine.alarms if memory.S[alarm.bit.number]]
        state = self._machine.tags.machine.state
        return {
            "state": memory.word(state.kind, state.number),
            "alarms": {"rows": [{"number": number, "state": _UNACKNOWLEDGED} for number in alarms]},
            "arms": {side: self._facts.arm(memory, side) for side in SIDES},
            "tray": self._facts.tray(memory),
        }
