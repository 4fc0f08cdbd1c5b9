"""Drawing of random stories: uniformly, or by swarm testing, in which each story has a random subset of the kinds."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from controller.common.errors import InputError
from controller.common.suggestion import suggestion
from controller.program.machine import Transplanter
from controller.program.operator.buttons import ANSWER_PRESS_MS, STUCK_MS
from plant_sim.faults import FAULTS
from plant_sim.machine.plant import Plant
from plant_sim.stories.drawn.action import BUTTONS, MEMORIES, STATUSES, Deed, RandomStory, StoryAction
from plant_sim.twin.lock_step import CLEAR_MS

TRAYS: Final = 3
WORK_MS: Final = 45_000
"""Longest work before the first action, ms: more than a tray at the speed of the stories."""
LASTS_MS: Final = 45_000
"""Longest time from the first to the last action, ms."""
TEND_MS: Final = (1_000, 6_000)
"""Time from one look of the operator at the machine to the next, ms."""
FRESH_SHARE: Final = 0.15
"""Share of the stories that begin right after power-up."""
FEWEST, MOST = 3, 8
"""Number of actions besides those of the operator who tends the machine."""
MOST_FAULTS: Final = 3
PUSH_MM: Final = 60.0
FASTEST_PER_MIN: Final = 130.0
WIDE: Final = 100.0
"""Ratio of the limits of a size beyond which its logarithm is drawn."""


@dataclass(frozen=True)
class Menu:
    """Everything that can be drawn for a machine.

    Attributes:
        faults: Targets by kind of fault; sensors that are not wired are omitted.
        commands: Commands other than jog commands.
        jogs: Jog commands.
        outputs: Outputs with a manual override.
    """

    faults: Mapping[str, tuple[str, ...]]
    commands: tuple[str, ...]
    jogs: tuple[str, ...]
    outputs: tuple[str, ...]


def check_targets(story: RandomStory, menu: Menu) -> None:
    """Check that the machine has the targets of all actions.

    Raises:
        InputError: It does not have one.
    """
    known = {Deed.COMMAND: menu.commands, Deed.JOG: menu.jogs, Deed.OVERRIDE: menu.outputs}
    for action in story.actions:
        if action.deed is Deed.FAULT:
            names = tuple(f"{action.kind}:{each}" for each in menu.faults.get(action.kind, ()))
        else:
            names = known.get(action.deed, (action.target,))
        if action.target not in names:
            raise InputError(f"{action}: {action.target}: unknown; {suggestion(action.target, names)}")


def menu_of(machine: Transplanter, plant: Plant) -> Menu:
    """Return everything that can be drawn for a program and a plant."""
    unwired = plant.sensors.keys() - {*plant.wired}
    names = [command.name for command in machine.tags.commands]
    jogs = tuple(name for name in names if name.startswith("jog_") and name != "jog_release")
    faults = {name: tuple(part for part in kind.parts(plant) if part not in unwired) for name, kind in FAULTS.items()}
    return Menu(
        {name: targets for name, targets in faults.items() if targets},
        tuple(name for name in names if name not in jogs),
        jogs,
        tuple(point.tag for point in machine.io_map.outputs if "." in point.tag),
    )


class StoryDraw:
    """Source of random stories.

    Attributes:
        menu: Everything that can be drawn.
    """

    def __init__(self, menu: Menu, name: str, *, swarm: bool = True) -> None:
        """Prepare the drawing of one story.

        Args:
            menu: Everything that can be drawn.
            name: Text from which all numbers follow.
            swarm: True to choose a random subset of kinds first; False to draw every action from all of them.
        """
        self.menu = menu
        self._draws = random.Random(name)
        self._kinds, self._deeds = self._subset() if swarm else ([*menu.faults], [*_DRAWERS])

    def story(self) -> RandomStory:
        """Return a story."""
        draws = self._draws
        work_ms = 0 if draws.random() < FRESH_SHARE else draws.randrange(10, WORK_MS, 10)
        story = RandomStory(draws.randrange(1_000), TRAYS, work_ms)
        actions: list[StoryAction] = []
        faults = 0
        for _ in range(draws.randint(FEWEST, MOST)):
            deed = draws.choice(self._deeds)
            if deed is Deed.FAULT and (faults := faults + 1) > MOST_FAULTS:
                continue
            actions += _DRAWERS[deed](self, self.time_ms())
        return story.with_actions((*actions, *self.tending(LASTS_MS)))

    def tending(self, until_ms: int, from_ms: int = 0) -> list[StoryAction]:
        """Return the looks of the operator at the machine up to a time."""
        looks, at_ms = [], from_ms
        while (at_ms := at_ms + self._draws.randrange(*TEND_MS, 10)) < until_ms:
            looks.append(StoryAction(at_ms, Deed.TEND))
        return looks

    def time_ms(self) -> int:
        """Return a time of an action, ms."""
        return self._draws.randrange(0, LASTS_MS, 10)

    def duration_ms(self, low: int = 100, high: int = 30_000) -> int:
        """Return a duration, ms; short ones are as frequent as long ones."""
        return round(math.exp(self._draws.uniform(math.log(low), math.log(high)))) // 10 * 10

    def fault(self, at_ms: int, kind: str = "") -> StoryAction:
        """Return a fault of one of the kinds of this story, or of a given kind, of any size."""
        kind = kind or self._draws.choice(self._kinds)
        size = FAULTS[kind].size
        target = self._draws.choice(self.menu.faults[kind])
        drawn = None if size is None else self._size(size.low, size.high)
        lasts_ms = 0 if FAULTS[kind].permanent or self._draws.random() < 0.5 else self.duration_ms(200)
        return StoryAction(0 if FAULTS[kind].permanent else at_ms, Deed.FAULT, f"{kind}:{target}", drawn, lasts_ms)

    def _size(self, low: float, high: float) -> float:
        """Return a size from the whole range, its limits included."""
        edge = self._draws.random()
        if edge < 0.1:
            return low if edge < 0.05 else high
        if low > 0.0 and high / low > WIDE:
            drawn = math.exp(self._draws.uniform(math.log(low), math.log(high)))
        else:
            drawn = self._draws.uniform(low, high)
        return min(max(float(f"{drawn:.3g}"), low), high)

    def _subset(self) -> tuple[list[str], list[Deed]]:
        """Return the kinds of fault and of action of this story; each is present with an even chance."""
        draws = self._draws
        kinds = [kind for kind in self.menu.faults if draws.random() < 0.3] or [draws.choice([*self.menu.faults])]
        deeds = [deed for deed in _DRAWERS if draws.random() < 0.4]
        weight = draws.choice((0, 1, 3))
        return kinds, [*deeds, *[Deed.FAULT] * weight] or [Deed.FAULT]

    def faults_at(self, at_ms: int) -> list[StoryAction]:
        """Return a fault."""
        return [self.fault(at_ms)]

    def presses(self, at_ms: int) -> list[StoryAction]:
        """Return a press of one button, or of two together: short, long enough to answer or to clear, or stuck."""
        draws = self._draws
        target = "+".join(draws.sample(BUTTONS, draws.choice((1, 1, 1, 2))))
        lasts_ms = draws.choice((100, 100, ANSWER_PRESS_MS + 300, CLEAR_MS, STUCK_MS + 500, self.duration_ms(10)))
        return [StoryAction(at_ms, Deed.PRESS, target, for_ms=lasts_ms)]

    def commands(self, at_ms: int) -> list[StoryAction]:
        """Return a command."""
        return [StoryAction(at_ms, Deed.COMMAND, self._draws.choice(self.menu.commands))]

    def jogs(self, at_ms: int) -> list[StoryAction]:
        """Return a visit to manual mode with several jogs, or one jog out of place."""
        draws = self._draws
        if draws.random() < 0.3:
            return [self._jog(at_ms)]
        commands = [(0, "stop"), (12_000, "mode_manual"), (12_200, "start")]
        visit = [StoryAction(at_ms + after_ms, Deed.COMMAND, name) for after_ms, name in commands]
        visit += [self._jog(at_ms + 13_000 + 10 * number) for number in range(draws.randint(1, 5))]
        return visit

    def mends(self, at_ms: int) -> list[StoryAction]:
        """Return the end of a fault."""
        return [StoryAction(at_ms, Deed.MEND)]

    def airs(self, at_ms: int) -> list[StoryAction]:
        """Return other air in slides and lifts."""
        return [StoryAction(at_ms, Deed.AIR, size=self._draws.choice((0.0, round(self._draws.random(), 2))))]

    def speeds(self, at_ms: int) -> list[StoryAction]:
        """Return another speed: standstill, or any up to one that is not permitted; later the usual one."""
        draws = self._draws
        per_min = draws.choice((0.0, round(draws.uniform(5.0, FASTEST_PER_MIN), 1)))
        later_ms = at_ms + self.duration_ms(500, 15_000)
        return [StoryAction(at_ms, Deed.SPEED, size=per_min), StoryAction(later_ms, Deed.SPEED, size=60.0)]

    def powers(self, at_ms: int) -> list[StoryAction]:
        """Return a loss of power."""
        memory = self._draws.choice(MEMORIES)
        size = round(self._draws.random(), 3) if memory in {"old", "damaged"} else None
        return [StoryAction(at_ms, Deed.POWER, memory, size, self.duration_ms(100, 10_000))]

    def pushes(self, at_ms: int) -> list[StoryAction]:
        """Return a push of the trays, alone or during an emergency stop."""
        way_mm = round(self._draws.uniform(-PUSH_MM, PUSH_MM), 1)
        return self._isolated(at_ms, StoryAction(at_ms + 1_000, Deed.PUSH, size=way_mm))

    def overrides(self, at_ms: int) -> list[StoryAction]:
        """Return an operation of a manual override, alone or after a stop."""
        target = self._draws.choice(self.menu.outputs)
        lasts_ms = max(50, self.duration_ms(50, 3_000) // 50 * 50)
        moved = StoryAction(at_ms + 14_000, Deed.OVERRIDE, target, for_ms=lasts_ms)
        return [StoryAction(at_ms, Deed.COMMAND, self._draws.choice(("stop", "hold", "abort"))), moved]

    def removals(self, at_ms: int) -> list[StoryAction]:
        """Return the removal of a tray, alone or during an emergency stop."""
        return self._isolated(at_ms, StoryAction(at_ms + 1_000, Deed.TAKE_OFF))

    def answers(self, at_ms: int) -> list[StoryAction]:
        """Return a false answer after a stop that leads to questions."""
        lasts_ms = self.duration_ms(500, 3_000)
        stop = StoryAction(at_ms, Deed.PRESS, "emergency_stop", for_ms=lasts_ms)
        clears = StoryAction(at_ms + lasts_ms + 500, Deed.PRESS, "stop", for_ms=CLEAR_MS)
        homes = StoryAction(clears.at_ms + CLEAR_MS + 500, Deed.PRESS, "start", for_ms=100)
        return [stop, clears, homes, StoryAction(homes.at_ms + 300, Deed.ANSWER_FALSELY, for_ms=10_000)]

    def statuses(self, at_ms: int) -> list[StoryAction]:
        """Return a report of the runtime."""
        target = self._draws.choice(STATUSES)
        return [StoryAction(at_ms, Deed.STATUS, target, for_ms=self.duration_ms(100, 10_000))]

    def _jog(self, at_ms: int) -> StoryAction:
        return StoryAction(at_ms, Deed.JOG, self._draws.choice(self.menu.jogs), for_ms=self.duration_ms(100, 3_000))

    def _isolated(self, at_ms: int, action: StoryAction) -> list[StoryAction]:
        if self._draws.random() < 0.3:
            return [action]
        return [StoryAction(at_ms, Deed.PRESS, "emergency_stop", for_ms=3_000), action]


_DRAWERS: Final[Mapping[Deed, Callable[[StoryDraw, int], Sequence[StoryAction]]]] = {
    Deed.FAULT: StoryDraw.faults_at,
    Deed.PRESS: StoryDraw.presses,
    Deed.COMMAND: StoryDraw.commands,
    Deed.JOG: StoryDraw.jogs,
    Deed.MEND: StoryDraw.mends,
    Deed.AIR: StoryDraw.airs,
    Deed.SPEED: StoryDraw.speeds,
    Deed.POWER: StoryDraw.powers,
    Deed.PUSH: StoryDraw.pushes,
    Deed.OVERRIDE: StoryDraw.overrides,
    Deed.TAKE_OFF: StoryDraw.removals,
    Deed.ANSWER_FALSELY: StoryDraw.answers,
    Deed.STATUS: StoryDraw.statuses,
}
"""Drawing of the actions of each kind; the operator who tends the machine is in every story."""
