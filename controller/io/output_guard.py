"""Detection of another master that writes the outputs of the same I/O module.

Two kinds of modules: one that lends its outputs to one client at a time refuses the writes of the others and reports
the owner, as the simulated plant does. On any other module, the outputs are read back before they
are written. A master that writes equal values cannot be detected there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, auto

from controller.io.link import LinkError
from controller.io.modbus_tcp import ModbusTcpLink


class ModuleKind(Enum):
    """Behaviour of a module towards a second master."""

    LENDS = auto()
    READ_BACK = auto()
    BLIND = auto()


class ModbusOutputGuard:
    """`OutputGuard` of a Modbus link.

    Attributes:
        kind: Behaviour of the module; `BLIND` before `identify`.
    """

    def __init__(self, link: ModbusTcpLink, *, every: int) -> None:
        """Create the guard of a link.

        Args:
            link: Link to the module.
            every: Number of scans from one reading of the report on the owner to the next.
        """
        self.kind = ModuleKind.BLIND
        self._link = link
        self._every = every
        self._left = 1
        self._rival = ""
        self._holder = ""

    def identify(self) -> ModuleKind:
        """Find out the kind of the module on an open link; a module that does not answer is connected again.

        Raises:
            LinkError: The module cannot be connected again.
        """
        if self._works(self._link.read_owner):
            self.kind, self._link.lends = ModuleKind.LENDS, True
        elif self._works(self._link.read_outputs):
            self.kind = ModuleKind.READ_BACK
        return self.kind

    def mismatch(self, written: Sequence[bool]) -> str:
        """Return how the outputs differ from the image written last; empty for a module that lends its outputs."""
        if self.kind is not ModuleKind.READ_BACK:
            return ""
        found = self._link.read_outputs()
        wired = [number for number in self._link.outputs if found[number] != written[number]]
        return f"{_listed(wired)} changed by another master or by the watchdog of the module" if wired else ""

    def holder(self, safe: Sequence[bool]) -> str:
        """Return who holds the outputs; on a module that does not report it, whether they are not safe."""
        if self.kind is ModuleKind.LENDS and self._is_due():
            self._holder = self._link.read_owner().owner
        elif self.kind is ModuleKind.READ_BACK:
            self._holder = self.mismatch(safe)
        return self._holder

    def rival(self) -> str:
        """Return the refused writes, as read in one of the last `every` scans."""
        if self.kind is ModuleKind.LENDS and self._is_due():
            report = self._link.read_owner()
            self._rival = f"{report.refused} {report.rival}"
        return self._rival

    def _is_due(self) -> bool:
        self._left = (self._left or self._every) - 1
        return self._left == 0

    def _works(self, attempt: Callable[[], object]) -> bool:
        try:
            attempt()
        except LinkError:
            self._link.open()
            return False
        return True


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(f"Y{number:o}" for number in numbers)
