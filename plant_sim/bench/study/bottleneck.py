"""The bottleneck: what the critical path of a late round is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from plant_sim.bench.study.critical_path import CUP_WAITS, Round, Segment, by_device, by_motion
from plant_sim.bench.study.pace import Pace, round_needed_s
from plant_sim.bench.study.parts import Table
from plant_sim.bench.study.timeline import ARM, Timeline, motion_of


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

    @property
    def longest(self) -> Segment:
        """The motion on the path that is longest by itself."""
        return max((each for each in self.round.path if each.motion.kind == "moves"), key=lambda each: each.length_ms)

    @property
    def waiting_s(self) -> float:
        """How long the arm waited until the other arm or the tray let it go on, s; its wait for cups is none of it."""
        since_ms, until_ms = self.round.since.at_ms, self.round.throw.at_ms
        return sum(
            max(0, min(each.to_ms, until_ms) - max(each.from_ms, since_ms))
            for each in self.timeline.stretches[ARM[self.round.throw.side]]
            if motion_of(each.who, each.step).kind == "waits" and each.step not in CUP_WAITS
        ) / 1000  # fmt: skip

    def text(self) -> str:
        """Return what holds the round up, in one paragraph."""
        throw, longest = self.round.throw, self.longest
        device_s = by_device(self.round.path)[self.device] / 1000
        most, most_ms = next(iter(by_motion(self.round.path).items()))
        return (
            f"{self.title.capitalize()}, {self.frequency_per_min}/min is the lowest frequency observed at which an arm "
            f"is late: the {ARM[throw.side]} with row {throw.row}, by {-self.round.margin_ms / 1000:.2f} s; twelve "
            f"cups pass in {round_needed_s(self.frequency_per_min):.2f} s, its round takes {self.round_s:.2f} s. On "
            f"the critical path the {self.device} takes {device_s:.2f} s in total "
            f"({100 * device_s / self.round_s:.0f} %), and of all motions {most.name} the most, "
            f"{most_ms / 1000:.2f} s in total; the longest by itself is {longest.motion.name} ({longest.who}), "
            f"{longest.length_ms / 1000:.2f} s. The {ARM[throw.side]} waits {self.waiting_s:.2f} s until the other "
            "arm or the tray lets it go on."
        )

    def table(self) -> Table:
        """Return the motions on the path, the longest first."""
        return Table(
            f"path-{self.name}",
            f"Critical path {self.title}, by motion: totals of whoever makes it",
            ("motion", "device", "total, s", "% of the round"),
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
            "longest_motion": {
                "who": self.longest.who,
                "motion": self.longest.motion.name,
                "s": self.longest.length_ms / 1000,
            },
            "waiting_s": self.waiting_s,
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
