"""Detection of another master that writes the outputs of the same I/O modules.

A module that lends its outputs to one client at a time refuses the writes of the others and reports the owner, as the
simulated plant does. A module with a write lock refuses them as well. On any other module, the outputs are read back
before they are written. A master that writes equal values cannot be detected there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, auto
from functools import partial
from typing import Final

from controller.common.modbus.output_owner import OwnerReport
from controller.io.field.device import DeviceRefusalError, FieldDevice
from controller.io.field.line import complete
from controller.io.field.link import DevicesLink
from controller.io.link import LinkError

_ATTEMPTS: Final = 3
"""Number of requests without an answer after which a device is taken not to know the request (assumed)."""


class ModuleKind(Enum):
    """Behaviour of a module towards a second master."""

    LENDS = auto()
    LOCKED = auto()
    READ_BACK = auto()
    BLIND = auto()


class ModbusOutputGuard:
    """`OutputGuard` of a Modbus link.

    Attributes:
        kinds: Behaviour of each device with outputs; `BLIND` before `identify`.
    """

    def __init__(self, link: DevicesLink, *, every: int) -> None:
        """Create the guard of a link.

        Args:
            link: Link to the modules.
            every: Number of scans from one reading of the report on the owner to the next.
        """
        self.kinds = {device: ModuleKind.BLIND for device in link.devices if device.outputs}
        self._link = link
        self._every = every
        self._left = 1
        self._rival = ""
        self._holder = ""

    def identify(self) -> None:
        """Find out the kinds of the modules on an open link; a module that does not answer is connected again.

        Raises:
            LinkError: A module cannot be connected again.
        """
        for device in self.kinds:
            if device.plan.traits.locked:
                self.kinds[device] = ModuleKind.LOCKED
            elif self._works(partial(_read_owner, device)):
                self.kinds[device], device.lends = ModuleKind.LENDS, True
            elif self._works(partial(self._link.read_outputs, [device])):
                self.kinds[device] = ModuleKind.READ_BACK

    @property
    def blind(self) -> list[str]:
        """Labels of the devices on which another master is not detected."""
        return [device.label for device, kind in self.kinds.items() if kind is ModuleKind.BLIND]

    def mismatch(self, written: Sequence[bool]) -> str:
        """Return how the outputs that are read back differ from the image written last."""
        confirmed = (device for device in self._of(ModuleKind.READ_BACK) if device.confirmed is not None)
        return self._differing(list(confirmed), written)

    def holder(self, safe: Sequence[bool]) -> str:
        """Return who holds the outputs; on a module that does not report it, whether they are not safe."""
        changed = self._differing(self._of(ModuleKind.READ_BACK), safe)
        lending = self._of(ModuleKind.LENDS)
        if lending and self._is_due():
            self._holder = next(filter(None, (_read_owner(device).owner for device in lending)), "")
        return changed or self._holder

    def rival(self) -> str:
        """Return the refused writes, as read in one of the last `every` scans."""
        lending = self._of(ModuleKind.LENDS)
        if lending and self._is_due():
            reports = [_read_owner(device) for device in lending]
            rival = next((report.rival for report in reports if report.rival), "")
            self._rival = f"{sum(report.refused for report in reports)} {rival}"
        return self._rival

    def _of(self, kind: ModuleKind) -> list[FieldDevice]:
        return [device for device, found in self.kinds.items() if found is kind]

    def _differing(self, devices: Sequence[FieldDevice], written: Sequence[bool]) -> str:
        devices = [device for device in devices if not device.tripped]
        if not devices:
            return ""
        found = self._link.read_outputs(devices)
        changed = []
        for device in devices:
            wired = [number for number, _ in device.plan.outputs if found[number] != written[number]]
            if wired:
                complete(device.note_trip())
            changed += [] if device.tripped else wired
        return f"{_listed(changed)} changed by another master or by the watchdog of the module" if changed else ""

    def _is_due(self) -> bool:
        self._left = (self._left or self._every) - 1
        return self._left == 0

    def _works(self, attempt: Callable[[], object]) -> bool:
        """Return True if a request is answered; a device that does not answer at all is asked several times."""
        for _ in range(_ATTEMPTS):
            try:
                attempt()
            except DeviceRefusalError:
                self._link.open()
                return False
            except LinkError:
                self._link.open()
            else:
                return True
        return False


def _read_owner(device: FieldDevice) -> OwnerReport:
    return complete(device.read_owner())


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(f"Y{number:o}" for number in numbers)
