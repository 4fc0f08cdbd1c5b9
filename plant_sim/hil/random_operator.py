"""An operator who presses at random for a long time, but answers truly and clears as documented."""

from __future__ import annotations

from functools import partial
from random import Random
from typing import Final

from plant_sim.hil.bench import Bench
from plant_sim.hil.cases import Case, home, run, shortage_of_trays, stop_and_clear
from plant_sim.hil.procedure import NotRunError, Procedure
from plant_sim.twin.ladder.question_lamp import PERIOD_MS

RANDOM: Final = "random operator"
SHORT_MS: Final = (60, 1_800)
"""Shortest and longest random press, ms: a press of 2 to 10 s could answer a question."""
PAUSE_MEAN_MS: Final = 4_000
STOPPED_MS: Final = (200, 8_000)
"""Shortest and longest press of the emergency stop, ms."""
SECONDS_PER_TRAY: Final = 40
"""Time in which the machine empties a tray at most, s: at 60 cups per minute and row it takes 36 s without a pause."""


def random_cases(for_s: int, seed: int) -> list[Case]:
    """Return the case of the random operator; none without a duration."""
    title = f"{for_s} s with seed {seed}"
    return [Case(RANDOM, title, partial(operate, for_s, seed), starts=True)] if for_s else []


def operate(for_s: int, seed: int, bench: Bench) -> Procedure:
    """Press at random; the rules for all cases apply, and nothing may switch on from an emergency stop to a start."""
    chance = Random(seed)
    end_ms = bench.now_ms + 1_000 * for_s
    while bench.now_ms < end_ms:
        if shortage := shortage_of_trays(bench):
            raise NotRunError(shortage)
        yield from bench.pause(round(chance.expovariate(1 / PAUSE_MEAN_MS)))
        action = chance.choices((_short_press, _both, _emergency_stop, _work), weights=(5, 1, 2, 2))[0]
        yield from action(chance, bench)
    yield from _work(chance, bench)


def _short_press(chance: Random, bench: Bench) -> Procedure:
    """Press start or stop for a short time."""
    button = chance.choice(("start", "stop"))
    if button == "start" and not bench.module.plant.box.emergency_stop:
        bench.forbidden = ""
    yield from bench.hold(button, chance.randint(*SHORT_MS))


def _both(chance: Random, bench: Bench) -> Procedure:
    """Press start while stop is held, which is a press of stop."""
    bench.end_work()
    bench.module.plant.box.stop = True
    yield from bench.pause(chance.randint(20, 500))
    yield from bench.hold("start", chance.randint(*SHORT_MS) // 2)
    bench.module.plant.box.stop = False
    yield from bench.pause(200)


def _emergency_stop(chance: Random, bench: Bench) -> Procedure:
    """Press the emergency stop, press start and stop meanwhile, and release it."""
    bench.press_emergency_stop()
    yield from bench.pause(chance.randint(*STOPPED_MS))
    yield from bench.hold(chance.choice(("start", "stop")), chance.randint(*SHORT_MS))
    bench.release_emergency_stop()
    yield from bench.pause(chance.randint(*STOPPED_MS))


def _work(chance: Random, bench: Bench) -> Procedure:
    """Clear, home and answer, and let the machine work for some rows."""
    yield from stop_and_clear(bench)
    yield from home(bench)
    yield from run(bench)
    yield from bench.pause(chance.randint(1_000, 2 * PERIOD_MS))
