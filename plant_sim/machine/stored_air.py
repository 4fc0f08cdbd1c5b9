"""Air stored in slides and lifts: vented, full or partly leaked, at once or by a leak over a time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from plant_sim.common.units import parse_quantity
from plant_sim.faults import Fault
from plant_sim.machine.plant import Plant
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.pneumatics.leak import leak_conductance

FULL_SHARE: Final = 0.9
"""Gauge pressure in slides and lifts after a normal stop, relative to the main line. Assumed."""
WORDS: Final = {"vented": 0.0, "full": FULL_SHARE}
LEAST_LEAK_MS: Final = 1_000
"""Shortest time of a leak, ms: in a shorter time, the air in a chamber would not remain at wall temperature."""
LEAST_SHARE: Final = 0.01
"""Lowest share at the end of a leak; the last part of the air leaves in infinite time."""


def parse_share(text: str) -> float:
    """Parse the air in slides and lifts: ``vented``, ``full``, or a share of the main gauge pressure such as ``30 %``.

    Raises:
        ValueError: The text is neither of these words nor a share from 0 to 1.

    >>> parse_share("vented"), parse_share("30 %")
    (0.0, 0.3)
    """
    if text in WORDS:
        return WORDS[text]
    try:
        share = parse_quantity(text, "-")
    except ValueError:
        share = -1.0
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"{text!r}: must be vented, full, or a share of the main pressure from 0 to 100 %")
    return share


def set_air(plant: Plant, share: float) -> None:
    """Set the pressure in all chambers of slides and lifts at once, without motion.

    A lift whose chambers are vented is not in balance: the arm sinks on the air that it compresses.

    Args:
        plant: The machine.
        share: Gauge pressure relative to the main line; 0 = vented.

    Raises:
        ValueError: The share is outside 0 to 1.
    """
    _check_share(share, 0.0)
    for arm in plant.arms.values():
        for device in (arm.slide, arm.lift):
            device.set_air(share * _regulated_pa(plant))


def relieve(plant: Plant, name: str) -> None:
    """Bring the air of one slide or lift into balance without motion, so that nothing drives it when it is freed.

    An operator supports the arm and vents both chambers; the balance stands for the support, which the plant lacks.

    Args:
        plant: The machine.
        name: Name of the device, such as ``left.slide``.
    """
    side, _, drive = name.partition(".")
    arm = plant.arms[side]
    device = arm.slide if drive == "slide" else arm.lift
    device.set_air(FULL_SHARE * _regulated_pa(plant))


def leak_down(plant: Plant, share: float, over_ms: int) -> list[Fault]:
    """Let the chambers of slides and lifts leak to a pressure over a time.

    Every chamber gets the leak that lowers its pressure to the given value in this time if its volume is constant and
    its air at wall temperature. A chamber with a lower pressure gets none. A sinking lift compresses its air while it
    leaks, so that the pressure at the end is higher.

    Args:
        plant: The machine.
        share: Gauge pressure at the end, relative to the main line.
        over_ms: Time, ms; the leaks end after it.

    Returns:
        The leaks; `Plant.faults` ends each of them.

    Raises:
        FaultError: A chamber already leaks.
        ValueError: The share is outside 0.01 to 1, or the time is less than one second.
    """
    check_leak(share, over_ms)
    now_ms, end_pa = plant.time_ms, ATMOSPHERE_PA + share * _regulated_pa(plant)
    leaks = []
    for name, line, params in _lines(plant):
        start_pa = float(line["chamber"]["pressure_pa"])
        if start_pa > end_pa:
            leak_m3_s_pa: float = leak_conductance(
                line, start_pa, end_pa, over_ms / 1000, float(params["critical_ratio"])
            )
            leaks.append(Fault("leak", name, now_ms, now_ms + over_ms, leak_m3_s_pa))
    for leak in leaks:
        plant.faults.add(leak)
    return leaks


def check_leak(share: float, over_ms: int) -> None:
    """Raise `ValueError` if the pressure or the time of a leak is out of range; arguments as for `leak_down`."""
    _check_share(share, LEAST_SHARE)
    if over_ms < LEAST_LEAK_MS:
        raise ValueError(f"{over_ms} ms: air leaks for at least {LEAST_LEAK_MS} ms; omit the time to set it at once")


def _lines(plant: Plant) -> Iterator[tuple[str, Any, Any]]:
    """Yield the name, the state and the parameters of every line to a chamber of a slide or lift."""
    for number, side in enumerate(plant.arms):
        for drive in ("slide", "lift"):
            for port in ("plus", "minus"):
                state, params = plant.state[0]["arms"][number], plant.params[0]["arms"][number]
                yield f"{side}.{drive}.{port}", state[drive][port], params[drive][port]


def _regulated_pa(plant: Plant) -> float:
    """Return the set pressure of the main line, gauge, Pa."""
    return float(plant.params[0]["air"]["network"]["regulated_pa"])


def _check_share(share: float, least: float) -> None:
    if not least <= share <= 1.0:
        raise ValueError(f"{share:g}: the share of the main pressure must be {least:g} to 1")
