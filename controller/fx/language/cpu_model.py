"""CPU models of the FX family: the numbers of devices and the parts of the language that differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from controller.core.devices import EXTENSION, RETENTIVE, SIZES


@dataclass(frozen=True, slots=True, eq=False)
class CpuModel:
    """CPU whose programs are read and executed.

    Attributes:
        key: Value of the option `--cpu`.
        name: Name in messages.
        sizes: Number of devices of each kind, including the special ranges of M and D; D also includes R.
        ranges: Numbers of each kind of device, pointer and nesting level; a group of devices must fit into one of them.
        retentive: Battery-backed ranges by kind of device.
        most_steps: Program memory, steps.
        is_fx3: Whether real constants, bits of data registers, extension registers and the instructions of an FX3U
            exist.
    """

    key: str
    name: str
    sizes: Mapping[str, int]
    ranges: Mapping[str, tuple[range, ...]]
    retentive: Mapping[str, tuple[range, ...]]
    most_steps: int
    is_fx3: bool = False

    def has(self, kind: str, number: int) -> bool:
        """Return whether the CPU has a device."""
        return any(number in span for span in self.ranges[kind])


def _ranges(sizes: Mapping[str, int], labels: int, relays: int, extension: int = 0) -> dict[str, tuple[range, ...]]:
    return {
        **{kind: (range(size),) for kind, size in sizes.items()},
        "M": (range(relays), range(8000, sizes["M"])),
        "D": (range(8000), range(8000, sizes["D"] - extension)),
        **({"R": (range(extension),)} if extension else {}),
        "V": (range(8),),
        "Z": (range(8),),
        "N": (range(8),),
        "P": (range(labels),),
    }


FX2N: Final = CpuModel("fx2n", "FX2N", SIZES, _ranges(SIZES, 128, 3072), RETENTIVE, 8_000)
"""FX2N without a memory cassette (program memory from memory; devices: docs/sources/fx2n.md 1.5)."""

_EXTENSION_REGISTERS: Final = 32_768
_FX3U_SIZES: Final = SIZES | {"M": 8512, "S": 4096, "T": 512, "D": EXTENSION + _EXTENSION_REGISTERS}
FX3U: Final = CpuModel(
    "fx3u",
    "FX3U",
    _FX3U_SIZES,
    _ranges(_FX3U_SIZES, 4096, 7680, _EXTENSION_REGISTERS),
    RETENTIVE | {"M": (range(500, 7680),), "S": (range(500, 4096),), "R": (range(_EXTENSION_REGISTERS),)},
    64_000,
    is_fx3=True,
)
"""FX3U. M, S, T and R: docs/sources/fx2n.md 3.1 (verified); labels, program memory and retention from memory. T256 to
T511 have a time base of 1 ms and are not retentive (from memory)."""

CPU_MODELS: Final = {model.key: model for model in (FX2N, FX3U)}
"""Models by the value of the option `--cpu`."""
