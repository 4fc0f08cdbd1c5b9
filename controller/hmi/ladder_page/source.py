"""Source of the scans that a ladder page shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from controller.common.errors import InputError
from controller.debug.why.answer import WhySentence
from controller.fx.language.operand_rules import Key
from controller.fx.observation.observation import ObservedAt
from controller.hmi.ladder_page.live_scan import LiveScan
from controller.hmi.ladder_page.program import PageProgram


class NotReadyError(Exception):
    """Raised while a program is translated: nothing is known about its scans yet."""


class NotConnectedError(Exception):
    """Raised if the controller does not respond; the message is one line."""


class ScanNotKeptError(InputError):
    """Raised for a scan that is not available, or no longer."""


class UnknownScanError(Exception):
    """Raised for a scan that is not known as executed.

    Attributes:
        seen: The scan.
    """

    def __init__(self, seen: LiveScan) -> None:
        """Take the scan."""
        super().__init__(f"scan {seen.held.number} is not known as executed")
        self.seen = seen


class RunPicture(Protocol):
    """Picture of the machine in a recorded run.

    Attributes:
        files: Folder of the modules and styles that draw it.
    """

    files: Path

    def description(self) -> dict[str, Any]:
        """Return what is the same in all scans: texts, dimensions, terminals."""

    def view(self) -> dict[str, Any]:
        """Return the machine in the present state of the run."""


class RunAccess(Protocol):
    """Recorded run with a position, which the commands of the debugger move.

    Attributes:
        picture: Picture of its machine; None = it has none.
    """

    picture: RunPicture | None

    async def execute(self, command: str) -> list[str]:
        """Execute a command and return the lines of its answer.

        Raises:
            InputError: The command is invalid.
        """

    async def state(self) -> dict[str, Any]:
        """Return the position, the length of the run and of its branch, and the marks of the slider."""

    async def machine(self, scan: int) -> dict[str, Any] | None:
        """Return the machine after a scan of the run that is shown; None = it has no picture.

        Raises:
            ScanNotKeptError: The scan is not recorded.
        """


class PageSource(Protocol):
    """Scans of one program."""

    @property
    def program(self) -> PageProgram:
        """The program."""

    @property
    def is_live(self) -> bool:
        """True if the scans are those of a running controller, which can be looked at only."""

    async def look(self, view: ObservedAt, scan: int | None = None) -> LiveScan:
        """Return one scan.

        Args:
            view: View that is needed; the other one may be missing.
            scan: Number of a scan that is kept; None = the last one.

        Raises:
            NotReadyError: The program is being translated.
            NotConnectedError: The controller does not respond.
            ScanNotKeptError: The scan is not kept.
        """

    async def keep(self) -> LiveScan:
        """Return the last scan in both views, and keep it for `look`.

        Raises:
            NotReadyError: The program is being translated.
            NotConnectedError: The controller does not respond.
        """

    async def explain(self, device: Key, scan: int | None = None) -> list[WhySentence]:
        """Return why a device is on or off after a scan.

        Args:
            device: The device.
            scan: Number of the scan; None = the last one, or that at the position in a recorded run.

        Raises:
            NotReadyError: The program is being translated.
            NotConnectedError: The controller does not respond.
            InputError: The device or the scan cannot be asked about; the message is one line.
            UnknownScanError: The scan is not known as executed.
        """

    def recorded(self) -> RunAccess | None:
        """Return the recorded run that the page moves in; None = the program is live, and can be looked at only."""

    async def run(self) -> None:
        """Prepare the source while the page is served."""
