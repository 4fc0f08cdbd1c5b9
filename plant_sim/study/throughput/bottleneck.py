"""Bottleneck: the motions on the critical path of a late round."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from controller.common.document.parts import Table
from plant_sim.study.throughput.critical_path import CUP_WAITS, Round, Segment, by_device, by_motion
from plant_sim.study.throughput.pace import CyclePace, round_needed_s
from plant_sim.study.throughput.timeline import ARM, Timeline, motion_of


@dataclass(frozen=True)
class Bottleneck:
    """Round with the largest delay at the lowest frequency at which any round is late.

    Attributes:
        frequency_per_min: Lowest planting frequency with a late round.
        round: Round with the largest delay at that frequency.
        timeline: Timeline of the run with this round.
    """

    frequency_per_min: int
    round: Round
    timeline: Timeline

    @property
    def name(self) -> str:
        """File stem, which states whether the round includes a tray change."""
        return "with-tray-change" if self.round.changes_tray else "without-tray-change"

    @property
    def title(self) -> str:
        """Title, which states whether the round includes a tray change."""
        return self.name.replace("-", " ")

    @property
    def device(self) -> str:
        """Device with the longest total time on the path."""
        return next(iter(by_device(self.round.path)))

    @property
    def round_s(self) -> float:
        """Time from throw to throw, s."""
        return (self.round.throw.at_ms - self.round.since.at_ms) / 1000

    @property
    def longest(self) -> Segment:
        """Longest single motion on the path."""
        return max((each for each in self.round.path if each.motion.kind == "moves"), key=lambda each: each.length_ms)

    @property
    def waiting_s(self) -> float:
        """Time for which the arm waited for the other arm or the tray, excluding the wait for cups, s."""
        since_ms, until_ms = self.round.since.at_ms, self.round.throw.at_ms
        return (
            sum(
                max(0, min(each.to_ms, until_ms) - max(each.from_ms, since_ms))
                for each in self.timeline.intervals[ARM[self.round.throw.side]]
                if motion_of(each.sequence, each.step).kind == "waits" and each.step not in CUP_WAITS
            )
            / 1000
        )

    def text(self) -> str:
        """Return a description of the bottleneck in one paragraph."""
        throw, longest = self.round.throw, self.longest
        device_s = by_device(self.round.path)[self.device] / 1000
        most, most_ms = next(iter(by_motion(self.round.path).items()))
        return (
            f"{self.title.capitalize()}, {self.frequency_per_min}/min is the lowest frequency observed at which an arm "
            f"is late: the {ARM[throw.side]} with row {throw.row}, by {-self.round.margin_ms / 1000:.2f} s. Twelve "
            f"cups pass in {round_needed_s(self.frequency_per_min):.2f} s; the round takes {self.round_s:.2f} s. On "
            f"the critical path the {self.device} takes {device_s:.2f} s in total "
            f"({100 * device_s / self.round_s:.0f} %). The motion with the longest total time is {most.name}, "
            f"{most_ms / 1000:.2f} s; the longest single motion is {longest.motion.name} "
            f"({longest.sequence}), {longest.length_ms / 1000:.2f} s. The {ARM[throw.side]} waits "
            f"{self.waiting_s:.2f} s for the other arm or the tray."
        )

    def table(self) -> Table:
        """Return a table of the motions on the path, longest first."""
        return Table(
            f"path-{self.name}",
            f"Critical path {self.title}, by motion: totals of all devices",
            ("motion", "device", "total, s", "% of the round"),
            tuple(
                (motion.name, motion.device, length_ms / 1000, length_ms / 10 / self.round_s)
                for motion, length_ms in by_motion(self.round.path).items()
            ),
        )

    def record(self) -> dict[str, object]:
        """Return the JSON record of the bottleneck."""
        return {
            "frequency_per_min": self.frequency_per_min,
            "arm": self.round.throw.side,
            "row": self.round.throw.row,
            "late_s": -self.round.margin_ms / 1000,
            "round_s": self.round_s,
            "device": self.device,
            "longest_motion": {
                "who": self.longest.sequence,
                "motion": self.longest.motion.name,
                "s": self.longest.length_ms / 1000,
            },
            "waiting_s": self.waiting_s,
            "motions_s": {motion.name: length / 1000 for motion, length in by_motion(self.round.path).items()},
            "devices_s": {device: length / 1000 for device, length in by_device(self.round.path).items()},
            "path": [
                {
                    "who": each.sequence,
                    "motion": each.motion.name,
                    "from_s": each.from_ms / 1000,
                    "to_s": each.to_ms / 1000,
                }
                for each in self.round.path
            ],
        }


def first_late(paces: Mapping[int, CyclePace], *, changes_tray: bool) -> Bottleneck | None:
    """Return the bottleneck at the lowest frequency with a late round; None if no round is late.

    A round is late if the arm arrives after its twelfth cup. An arm that has arrived in time may also miss a cup.

    Args:
        paces: Observed paces by ascending frequency.
        changes_tray: True for rounds with a tray change, False for those without.
    """
    for frequency, pace in paces.items():
        late = [each for each in pace.all_rounds if each.margin_ms < 0 and each.changes_tray == changes_tray]
        if late:
            latest = min(late, key=lambda each: each.margin_ms)
            return Bottleneck(frequency, latest, pace.timeline_of(latest))
    return None
