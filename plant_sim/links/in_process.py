"""The field link without a wire: controller and plant in one process, deterministic and fast."""

from __future__ import annotations

from collections.abc import Sequence

from plant_sim.links.io_module import IoModule, ModuleFault


class LinkDown(OSError):  # noqa: N818 - a state of the link, as read in `except LinkDown`
    """The in-process link is closed, or the module refused; `str()` is one line."""


class InProcessLink:
    """Satisfies the controller's `FieldLink` by shape alone; the plant does not import it.

    As over a wire, the link is closed after any `LinkDown` until `open` is called again. It moves
    images only: who advances plant time is another matter.
    """

    def __init__(self, module: IoModule) -> None:
        """Prepare a link to `module`, closed."""
        self._module = module
        self._is_open = False

    def open(self) -> None:
        """Open the link; does nothing on an open link."""
        self._is_open = True

    def read_inputs(self) -> list[bool]:
        """Read the raw X image.

        Raises:
            LinkDown: the link is not open.
        """
        self._require_open()
        return self._module.inputs()

    def write_outputs(self, image: Sequence[bool]) -> None:
        """Write the raw Y image.

        Args:
            image: Levels by Y number.

        Raises:
            LinkDown: the link is not open, or the module's watchdog has tripped.
            ValueError: the image has the wrong length.
        """
        expected = self._module.io_map.output_count
        if len(image) != expected:
            raise ValueError(f"Y image has {len(image)} levels, the map {expected}")
        self._require_open()
        try:
            self._module.write_outputs(0, image)
        except ModuleFault as fault:
            self.close()
            raise LinkDown(f"field I/O in process: {fault}") from fault

    def close(self) -> None:
        """Close the link; does nothing on a closed link."""
        self._is_open = False

    def _require_open(self) -> None:
        if not self._is_open:
            raise LinkDown("field I/O in process: the link is not open")
