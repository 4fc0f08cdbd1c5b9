"""Registers of I/O modules that protect their outputs from a second master.

Only documented registers are listed, none of them tested on hardware. A module that has no such register is protected
by its own lock or list of permitted addresses, see docs/hil.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from controller.io.link import LinkError
from controller.io.modbus_tcp import ModbusTcpLink


@dataclass(frozen=True, slots=True)
class ModuleProfile:
    """Settings that give the outputs of a module to one master.

    Attributes:
        settings: Value by address of the holding register.
        source: Documentation of the registers.
    """

    settings: Mapping[int, int]
    source: str

    def apply(self, link: ModbusTcpLink) -> None:
        """Write the settings that the module does not have yet, and read them back.

        Raises:
            LinkError: The module refuses a register, or reads another value than the one written.
        """
        for address, value in self.settings.items():
            if link.read_setting(address) == value:
                continue
            link.write_setting(address, value)
            found = link.read_setting(address)
            if found != value:
                raise LinkError(f"register {address:#06x} of the module reads {found} instead of {value}")


MODULE_PROFILES: Final[dict[str, ModuleProfile]] = {
    "beckhoff-ek9000": ModuleProfile(
        {0x1124: 1},
        "Beckhoff EK9000, Modbus interfaces: 0x1124 writelock, 1 = only the first writing master (the default)",
    ),
}
"""Profiles by value of ``--module``."""
