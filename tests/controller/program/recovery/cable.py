"""In-process link with a cable that can be disconnected."""

from __future__ import annotations

from collections.abc import Sequence

from plant_sim.links.in_process import InProcessLink, LinkDown


class CableLink(InProcessLink):
    """Link that transfers nothing and cannot be opened while the cable is disconnected."""

    pulled = False

    def open(self) -> None:
        if self.pulled:
            raise LinkDown("no cable")
        super().open()

    def read_inputs(self) -> list[bool]:
        if self.pulled:
            self.close()
        return super().read_inputs()

    def write_outputs(self, image: Sequence[bool]) -> None:
        if self.pulled:
            self.close()
        super().write_outputs(image)
