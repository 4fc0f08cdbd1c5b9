"""Input filters: a terminal must hold its level for a time before the X image follows."""

from __future__ import annotations

from collections.abc import Sequence

ADJUSTABLE = 16
FIXED_MS = 10


class InputFilter:
    """Digital filter in front of the X image, as in the FX2N: X0-X17 adjustable, X20 and up fixed at 10 ms.

    The FX2N samples its terminals freely; here they are seen once a scan, so a level must have been seen
    unchanged for the filter time.

    Attributes:
        filter_ms: Time of X0-X17, ms; may be changed at any time.
    """

    def __init__(self, image: list[bool], filter_ms: int) -> None:
        """Filter into an image.

        Args:
            image: The X image, changed in place.
            filter_ms: Time of X0-X17 in ms; 0 turns all filters off.

        Raises:
            ValueError: The FX2N filters 0 to 60 ms.
        """
        if not 0 <= filter_ms <= 60:
            raise ValueError(f"input filter {filter_ms} ms: an FX2N filters 0 to 60 ms")
        self._image = image
        self.filter_ms = filter_ms
        self._seen: list[bool] = []
        self._since_ms: dict[int, int] = {}
        self._started = False

    def latch(self, now_ms: int, levels: Sequence[bool]) -> None:
        """Take the terminals' levels of this scan; the first scan takes them as they are."""
        image = self._image
        count = len(levels)
        if image[:count] == levels and not self._since_ms:
            self._started = True
            return
        if not self._started or self.filter_ms == 0:
            image[:count] = levels
            self._started = True
            return
        for number, level in enumerate(levels):
            if level == image[number]:
                self._since_ms.pop(number, None)
                continue
            since_ms = self._since_ms.setdefault(number, now_ms)
            if now_ms - since_ms >= (self.filter_ms if number < ADJUSTABLE else FIXED_MS):
                image[number] = level
                del self._since_ms[number]
