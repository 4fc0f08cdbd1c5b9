"""Special function module with a buffer memory of 16-bit words, accessed by FROM and TO."""

from __future__ import annotations

from collections.abc import Mapping, Sequence


class BufferModule:
    """Module whose buffer memory contains what the program has written to it.

    Attributes:
        words: Buffer memory, signed 16-bit words.
    """

    def __init__(self, size: int, initial: Mapping[int, int]) -> None:
        """Fill the buffer memory.

        Args:
            size: Number of words.
            initial: Words that are not 0, by number.
        """
        self.words = [initial.get(number, 0) for number in range(size)]

    def read(self, first: int, count: int, now_ms: int) -> list[int]:
        """Return consecutive words at a time in ms.

        Raises:
            IndexError: The module does not have the words.
        """
        self._require(first, count)
        self.refresh(now_ms)
        return self.words[first : first + count]

    def write(self, first: int, values: Sequence[int], now_ms: int) -> None:
        """Write consecutive words at a time in ms.

        Raises:
            IndexError: The module does not have the words.
        """
        self._require(first, len(values))
        self.refresh(now_ms)
        self.words[first : first + len(values)] = values
        self.written(range(first, first + len(values)), now_ms)

    def refresh(self, now_ms: int) -> None:
        """Update the words that the module itself writes."""

    def written(self, numbers: range, now_ms: int) -> None:
        """Process words that the program has written."""

    def _require(self, first: int, count: int) -> None:
        if not 0 <= first <= first + count <= len(self.words):
            raise IndexError(first)
