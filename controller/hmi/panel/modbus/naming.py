"""Names that the panel tells the controller: its own, and those of its operators for the audit log."""

from __future__ import annotations

from typing import Final

from controller.common.modbus.client_requests import write_registers
from controller.hmi.access.status_registers import NAME_WORDS, R_NAME
from controller.hmi.modbus.fx3u_map import register_address

NAME_ADDRESS: Final = register_address("R", R_NAME)
PANEL_NAME: Final = "panel"


def name_words(name: str) -> list[int]:
    """Return an operator name for the audit log: ASCII, two characters per register, padded with zeros."""
    text = name.encode("ascii").ljust(2 * NAME_WORDS, b"\0")[: 2 * NAME_WORDS]
    return [int.from_bytes(text[index : index + 2]) for index in range(0, len(text), 2)]


INTRODUCTION: Final = write_registers(NAME_ADDRESS, name_words(PANEL_NAME))
"""First request of the panel; the controller reserves places for connections with its name."""
