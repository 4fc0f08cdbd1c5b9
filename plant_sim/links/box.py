"""Operator box as Modbus coils, for clients that operate its buttons.

True means pressed; the polarity of the contact is defined in the I/O map. A button remains pressed
until the client releases it.
"""

from __future__ import annotations

from dataclasses import dataclass

from plant_sim.devices.operator_box import OperatorBox


@dataclass(frozen=True, slots=True)
class BoxCoil:
    """A button of the operator box.

    Attributes:
        offset: Modbus coil offset.
        button: Attribute of `OperatorBox`.
        meaning: Function of the button.
    """

    offset: int
    button: str
    meaning: str

    def pressed(self, box: OperatorBox) -> bool:
        """Return True if the button is pressed."""
        return bool(getattr(box, self.button))

    def press(self, box: OperatorBox, pressed: bool) -> None:
        """Press or release the button."""
        setattr(box, self.button, pressed)


BOX_COILS = (
    BoxCoil(100, "start", "machine start (X0)"),
    BoxCoil(101, "stop", "machine stop (X24)"),
    BoxCoil(102, "emergency_stop", "emergency stop (X25); also removes coil power"),
    BoxCoil(103, "reset", "reset, if wired in the I/O map"),
    BoxCoil(104, "guard", "guard open, if wired in the I/O map; also removes coil power"),
)
