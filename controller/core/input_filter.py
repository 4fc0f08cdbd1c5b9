"""Input filters: the X image follows a terminal only after its level has been stable for the filter time."""

from __future__ import annotations

from collections.abc import Sequence

from controller.common.saved import Saved

ADJUSTABLE = 16
"""Number of terminals with an adjustable filter, X0-X17."""
LONGEST_FILTER_MS = 60
"""Longest filter time of these terminals, ms: the range of an FX2N."""
FIXED_MS = 10
"""Filter time of all other terminals, ms."""


class InputFilter(Saved):
    """Digital filter in front of the X image, as in the FX2N: X0-X17 adjustable, X20 and up fixed at 10 ms.

    The FX2N samples its terminals continuously. Here they are sampled once per scan, and between scans by `sample`;
    a level must be the same in every sample within the filter time.

    Attributes:
        filter_ms: Filter time of X0-X17, ms; may be changed at any time.
        since_ms: Time since which a terminal has differed from the image, ms, by number.
    """

    SAVED = ("_started", "filter_ms", "since_ms")

    def __init__(self, image: list[bool], filter_ms: int) -> None:
        """Create a filter for an image.

        Args:
            image: X image, changed in place.
            filter_ms: Filter time of X0-X17, ms; 0 disables all filters.

        Raises:
            ValueError: The time is outside the FX2N's range of 0 to 60 ms.
        """
        if not 0 <= filter_ms <= LONGEST_FILTER_MS:
            raise ValueError(f"input filter {filter_ms} ms: must be 0 to {LONGEST_FILTER_MS} ms, the range of an FX2N")
        self._image = image
        self.filter_ms = filter_ms
        self.since_ms: dict[int, int] = {}
        self._started = False

    def sample(self, now_ms: int, levels: Sequence[bool]) -> None:
        """Sample the terminals between two scans; the image is unchanged."""
        if not self._started or self.filter_ms == 0 or (self._image[: len(levels)] == levels and not self.since_ms):
            return
        for number, level in enumerate(levels):
            if level == self._image[number]:
                self.since_ms.pop(number, None)
            else:
                self.since_ms.setdefault(number, now_ms)

    def latch(self, now_ms: int, levels: Sequence[bool]) -> None:
        """Update the image with the filtered terminal levels of this scan; the first scan copies them unfiltered."""
        image = self._image
        count = len(levels)
        if image[:count] == levels and not self.since_ms:
            self._started = True
            return
        if not self._started or self.filter_ms == 0:
            image[:count] = levels
            self._started = True
            return
        for number, level in enumerate(levels):
            if level == image[number]:
                self.since_ms.pop(number, None)
                continue
            since_ms = self.since_ms.setdefault(number, now_ms)
            if now_ms - since_ms >= (self.filter_ms if number < ADJUSTABLE else FIXED_MS):
                image[number] = level
                del self.since_ms[number]
