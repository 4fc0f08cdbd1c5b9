"""The operator box as Modbus coils, for whoever presses its buttons from outside.

True means pressed; the polarity of the contact behind a button is the I/O map's business. A press
lasts as long as the client lets it last.
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
        meaning: What the button does to the machine.
    """

    offset: int
    button: str
    meaning: str

    def pressed(self, box: OperatorBox) -> bool:
        """Whether the button is pressed."""
        return bool(getattr(box, self.button))

    def press(self, box: OperatorBox, pressed: bool) -> None:
        """Press the button, or let go of it."""
        setattr(box, self.button, pressed)


BOX_COILS = (
    BoxCoil(100, "start", "machine start (X0)"),
    BoxCoil(101, "stop", "machine stop (X24)"),
    BoxCoil(102, "emergency_stop", "emergency stop (X25); also takes the coils' power"),
    BoxCoil(103, "reset", "reset, where the I/O map wires it"),
)
