"""The bottleneck: what the critical path of a late round is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from plant_sim.bench.study.critical_path import Round, by_device, by_motion
from plant_sim.bench.study.pace import Pace, round_needed_s
from plant_sim.bench.study.parts import Table
from plant_sim.bench.study.timeline import ARM, Timeline


@dataclass(frozen=True)
class Bottleneck:
    """The round that is late first.

    Attributes:
        frequency_per_min: The lowest planting frequency at which one is late.
        round: The latest there.
        timeline: The run it is part of.
    """

    frequency_per_min: int
    round: Round
    timeline: Timeline

    @property
    def name(self) -> str:
        """Whether a tray was changed, for the name of a file."""
        return "with-tray-change" if self.round.changes_tray else "without-tray-change"

    @property
    def title(self) -> str:
        """The same in words."""
        return self.name.replace("-", " ")

    @property
    def device(self) -> str:
        """The device that is longest on the path."""
        return next(iter(by_device(self.round.path)))

    @property
    def round_s(self) -> float:
        """From throw to throw, s."""
        return (self.round.throw.at_ms - self.round.since.at_ms) / 1000

    def others_s(self) -> float:
        """Return how much of the path belongs to neither the arm nor its cups, s."""
        own = self.round.throw.side
        return sum(each.length_ms for each in self.round.path if own not in each.who) / 1000

    def text(self) -> str:
        """Return what holds the round up, in one paragraph."""
        throw = self.round.throw
        device_s = by_device(self.round.path)[self.device] / 1000
        motion, motion_ms = next(iter(by_motion(self.round.path).items()))
        return (
            f"{self.title.capitalize()} an arm is late from {self.frequency_per_min}/min on: the {ARM[throw.side]} "
            f"with row {throw.row}, by {-self.round.margin_ms / 1000:.2f} s; twelve cups pass in "
            f"{round_needed_s(self.frequency_per_min):.2f} s, its round takes {self.round_s:.2f} s. Of that the "
            f"{self.device} takes {device_s:.2f} s ({100 * device_s / self.round_s:.0f} %); the longest single motion "
            f"is {motion.name}, {motion_ms / 1000:.2f} s. {self.others_s():.2f} s are spent waiting for the other arm "
            "or the tray."
        )

    def table(self) -> Table:
        """Return the motions on the path, the longest first."""
        return Table(
            f"path-{self.name}",
            f"Critical path {self.title}, by motion",
            ("motion", "device", "s", "% of the round"),
            tuple(
                (motion.name, motion.device, length_ms / 1000, length_ms / 10 / self.round_s)
                for motion, length_ms in by_motion(self.round.path).items()
            ),
        )

    def record(self) -> dict[str, object]:
        """Return it for programs."""
        return {
            "frequency_per_min": self.frequency_per_min,
            "arm": self.round.throw.side,
            "row": self.round.throw.row,
            "late_s": -self.round.margin_ms / 1000,
            "round_s": self.round_s,
            "device": self.device,
            "motions_s": {motion.name: length / 1000 for motion, length in by_motion(self.round.path).items()},
            "devices_s": {device: length / 1000 for device, length in by_device(self.round.path).items()},
            "path": [
                {"who": each.who, "motion": each.motion.name, "from_s": each.from_ms / 1000, "to_s": each.to_ms / 1000}
                for each in self.round.path
            ],
        }


def first_late(paces: Mapping[int, Pace], *, changes_tray: bool) -> Bottleneck | None:
    """Return the latest round at the lowest frequency at which one is late; None if none is.

    Args:
        paces: What was observed, by frequency, rising.
        changes_tray: Whether to look at rounds with a tray change or at those without.
    """
    for frequency, pace in paces.items():
        late = [each for each in pace.all_rounds if each.missed_cups and each.changes_tray == changes_tray]
        if late:
            latest = min(late, key=lambda each: each.margin_ms)
            return Bottleneck(frequency, latest, pace.timeline_of(latest))
    return None
