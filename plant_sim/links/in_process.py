"""In-process field link between controller and plant, deterministic and fast."""

from __future__ import annotations

from collections.abc import Sequence

from controller.common.saved import Saved
from plant_sim.links.io_module import IoModule, ModuleFault


class LinkDown(OSError):  # noqa: N818 - the name states the condition of the link
    """Closed in-process link, or output refused by the module; the message is one line."""


class InProcessLink(Saved):
    """Field link that satisfies the controller's `FieldLink` protocol structurally, without importing it.

    As with a network connection, the link remains closed after any `LinkDown` until `open` is called again. It
    transfers images only; plant time is advanced elsewhere.

    Attributes:
        module: I/O module at the other end.
        is_cut: True while the cable is disconnected; nothing is transferred, and the link cannot be opened.
    """

    SAVED = ("_is_open", "is_cut")

    def __init__(self, module: IoModule) -> None:
        """Create a closed link to a module."""
        self.module = module
        self._is_open = False
        self.is_cut = False

    def open(self) -> None:
        """Open the link; no effect if it is open.

        Raises:
            LinkDown: The cable is disconnected.
        """
        if self.is_cut:
            raise LinkDown("field I/O in process: the cable is disconnected")
        self._is_open = True

    def read_inputs(self) -> list[bool]:
        """Read the raw X image.

        Raises:
            LinkDown: The link is not open.
        """
        self._require_open()
        return self.module.inputs()

    def write_outputs(self, image: Sequence[bool]) -> None:
        """Write the raw Y image.

        Args:
            image: Levels by Y number.

        Raises:
            LinkDown: The link is not open, or the watchdog of the module has tripped.
            ValueError: The image has the wrong length.
        """
        expected = self.module.io_map.output_count
        if len(image) != expected:
            raise ValueError(f"Y image has {len(image)} levels; the I/O map has {expected}")
        self._require_open()
        try:
            self.module.write_outputs(0, image)
        except ModuleFault as fault:
            self.close()
            raise LinkDown(f"field I/O in process: {fault}") from fault

    def write_registers(self, values: Sequence[int]) -> None:
        """Write the output registers.

        Args:
            values: Values by the order of `IoMap.registers`.

        Raises:
            LinkDown: The link is not open, or the watchdog of the module has tripped.
            ValueError: The number of values is wrong.
        """
        numbers = [register.number for register in self.module.io_map.registers]
        written = dict(zip(numbers, values, strict=True))
        self._require_open()
        try:
            self.module.write_registers(written)
        except ModuleFault as fault:
            self.close()
            raise LinkDown(f"field I/O in process: {fault}") from fault

    def close(self) -> None:
        """Close the link; no effect if it is closed."""
        self._is_open = False

    def _require_open(self) -> None:
        if self.is_cut or not self._is_open:
            self._is_open = False
            raise LinkDown("field I/O in process: the link is not open")
