"""Run of many random stories: their classes, coverage, and findings with the commands that replay them."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from controller.program.machine import Transplanter
from plant_sim.machine.parameters import Machine
from plant_sim.stories.drawn.action import RandomStory
from plant_sim.stories.drawn.coverage import Coverage
from plant_sim.stories.drawn.draw import TRAYS, check_targets, menu_of
from plant_sim.stories.drawn.guide import StoryGuide
from plant_sim.stories.drawn.known import KNOWN
from plant_sim.stories.drawn.minimise import MOST_PLAYS, minimise
from plant_sim.stories.drawn.play import StoryPlayer
from plant_sim.stories.drawn.verdict import FINDINGS, Accepts, HarmClass, Sighting, StoryJudge
from plant_sim.twin.lock_step import Twin

COMMAND: Final = ("python", "-m", "plant_sim", "stories")
NAMES: Final = {
    HarmClass.VIOLATION: "requirement violated",
    HarmClass.CRASH: "exception",
    HarmClass.STUCK: "not recovered",
    HarmClass.SILENT: "silent harm",
    HarmClass.KNOWN: "harm of a known cause",
    HarmClass.HIDDEN: "harm that no input shows",
    HarmClass.TOLD: "harm with an alarm",
    HarmClass.ORDERED: "harm by an action of the operator",
    HarmClass.NONE: "no harm",
}
"""Names of the classes in reports, the worst first."""


@dataclass
class StoryFinding:
    """Stories with the same finding.

    Attributes:
        sighting: First sighting; minimised once `minimise_findings` has been called.
        numbers: Numbers of the stories.
        actions: Number of actions of the first story before it was minimised.
    """

    sighting: Sighting
    numbers: list[int] = field(default_factory=list)
    actions: int = 0


@dataclass
class StoriesReport:
    """Result of a run of random stories.

    Attributes:
        seed: Seed of the run.
        coverage: Coverage.
        classes: Number of stories by class.
        examples: First story of each class with harm that is no finding.
        findings: Findings by signature.
        machine_ms: Simulated time, ms.
        files: Options for an I/O map and parameters other than the default ones, for the commands that replay.
    """

    seed: int
    coverage: Coverage
    classes: Counter[HarmClass] = field(default_factory=Counter)
    examples: dict[HarmClass, Sighting] = field(default_factory=dict)
    findings: dict[tuple[str, ...], StoryFinding] = field(default_factory=dict)
    machine_ms: int = 0
    files: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Number of stories."""
        return self.classes.total()

    def lines(self) -> Iterator[str]:
        """Yield the report line by line; the headline states the harm."""
        yield "; ".join(f"{name} {self.classes[each]}" for each, name in NAMES.items())
        yield f"{self.count} stories, seed {self.seed}, {self.machine_ms / 1000:,.0f} s of machine time"
        coverage = self.coverage
        yield (
            f"coverage: {len(coverage.triples):,} of {coverage.possible:,} state x step x fault kind "
            f"({coverage.share:.1%}); {coverage.share_of_reached:.1%} of those in the {len(coverage.places)} pairs of "
            "state and step that were reached"
        )
        yield f"never in effect: {', '.join(coverage.never) or 'none'}"
        for of_story, example in self.examples.items():
            yield f"example: {NAMES[of_story]}: {_told(example)}"
            yield f"  {replay_command(example.played.story, self.files)}"
        for finding in self.findings.values():
            yield from _finding_lines(finding)
            yield f"  {replay_command(finding.sighting.played.story, self.files)}"
        yield f"findings: {len(self.findings) or 'none'}"


class StoryRun:
    """Run of random stories with one program and one machine.

    Attributes:
        report: Result so far.
    """

    def __init__(
        self, machine: Transplanter, parameters: Machine, accepts: Accepts, *, seed: int, directed: bool = True
    ) -> None:
        """Prepare a run.

        Args:
            machine: Program and its tags.
            parameters: Parameters of the plant.
            accepts: Harm that no program can prevent, by action.
            seed: Seed of all stories.
            directed: False to draw every action uniformly, without regard to the coverage.
        """
        self._player = StoryPlayer(machine, parameters)
        plant = Twin(trays=TRAYS, io_map=machine.io_map, parameters=parameters, machine=machine, misfit=True).plant
        self._menu = menu_of(machine, plant)
        self._guide = StoryGuide(machine, self._menu, seed, directed=directed)
        self._judge = StoryJudge(self._player, accepts, KNOWN)
        self.report = StoriesReport(seed, self._guide.coverage)

    def play(self, number: int) -> Sighting:
        """Play the story with a number, and add it to the report."""
        played = self._player.play(self._guide.story(number))
        self._guide.add(played)
        sighting, report = self._judge.sighting(played), self.report
        report.classes[sighting.of_story] += 1
        report.machine_ms += played.ends_ms
        if sighting.of_story in FINDINGS:
            finding = report.findings.setdefault(sighting.signature, StoryFinding(sighting))
            finding.numbers.append(number)
        elif sighting.of_story is not HarmClass.NONE:
            report.examples.setdefault(sighting.of_story, sighting)
        return sighting

    def replay(self, story: RandomStory) -> Sighting:
        """Play one story and return its class as it is.

        Raises:
            InputError: The machine does not have a target of the story.
        """
        check_targets(story, self._menu)
        return self._judge.of_played(self._player.play(story))

    def minimise_findings(self, most_plays: int = MOST_PLAYS, tell: Callable[[str], None] = lambda _: None) -> None:
        """Minimise the first story of each finding.

        Args:
            most_plays: Largest number of stories to play for each finding.
            tell: Function that is called with the name of each finding.
        """
        for signature, finding in self.report.findings.items():
            tell(" ".join(signature))
            story = finding.sighting.played.story
            finding.actions = len(story.actions)
            shows = partial(self._judge.shows, signature=signature)
            least, _ = minimise(story, shows, most_plays=most_plays)
            finding.sighting = self.replay(least)


def replay_command(story: RandomStory, files: Sequence[str] = ()) -> str:
    """Return the command that replays a story, with the options for files other than the default ones."""
    return shlex.join([*COMMAND, *files, "--replay", str(story)])


def sighting_lines(sighting: Sighting) -> Iterator[str]:
    """Yield what happened in a story."""
    yield NAMES[sighting.of_story]
    if sighting.played.crash:
        yield f"  {sighting.played.crash}"
    for harm in sighting.played.harms:
        yield f"  {harm.text}; told by {', '.join(harm.alarms) or 'nothing'}"
        yield from (f"    {kind}: {text}" for kind, text in harm.kinds.items())


def _told(sighting: Sighting) -> str:
    known = f" ({sighting.known})" if sighting.known else ""
    return f"{sighting.harm.text if sighting.harm is not None else sighting.played.crash}{known}"


def _finding_lines(finding: StoryFinding) -> Iterator[str]:
    sighting = finding.sighting
    numbers = ", ".join(map(str, finding.numbers[:5])) + (" and others" if len(finding.numbers) > 5 else "")
    yield f"finding: {NAMES[sighting.of_story]}: {_told(sighting)} (story {numbers})"
    if sighting.harm is not None:
        yield from (f"    {kind}: {text}" for kind, text in sighting.harm.kinds.items())
    if finding.actions:
        yield f"  {finding.actions} actions minimised to {len(sighting.played.story.actions)}"
