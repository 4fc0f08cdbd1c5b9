"""Tags of the planting: pulse measurements, readiness of the arms, advice, and cups found empty."""

from __future__ import annotations

from collections.abc import Iterable

from controller.common.modbus.io_map import IoMap
from controller.core.expr import Counter, Expr, Timer, Word
from controller.program.areas import Area
from controller.program.inputs import Inputs


class PulseTags:
    """Relays, register, counter and timers that measure a pulse train."""

    def __init__(self, name: str, counter: int, m: Area, d: Area, t10: Area) -> None:
        self.measuring = m.bit(f"{name} measuring", f"a measurement of the {name} has begun")
        self.complete = m.bit(f"{name} complete", f"a measurement of the {name} is complete, this scan")
        self.stale = m.bit(f"{name} stale", f"no pulse of the {name} within the time limit")
        self.time = d.word(f"{name} time x10 ms", f"time of the last measurement of the {name}")
        self.counter = Counter(counter, f"planting.{name} pulses", f"pulses of the {name} in this measurement")
        self.timer = t10.timer(f"{name} timer", f"duration of the measurement of the {name}")
        self.t_gap = t10.timer(f"{name} gap", f"time since the last pulse of the {name}")


class ReadinessTags:
    """Relays, registers and timers that measure the preparation of a row by one arm."""

    def __init__(self, side: str, m: Area, d: Area, t10: Area) -> None:
        self.preparing = m.bit(f"{side} preparing", f"the {side} arm prepares its next row after a release")
        self.ready = m.bit(f"{side} ready", f"the {side} arm has its next row ready, this scan")
        self.waited = m.bit(f"{side} waited", "the arm has waited at feed since the release")
        self.times = self._times(side, "time", "time to prepare the {} row without waiting", d)
        self.times_with_wait = self._times(side, "wait", "time to prepare the {} row with waiting at feed", d)
        self.t_wait = t10.timer(f"{side} wait", f"waiting of the {side} arm at feed for a tray or for the other arm")
        self.timer = t10.timer(f"{side} row", f"preparation of a row by the {side} arm")

    @staticmethod
    def _times(side: str, name: str, comment: str, d: Area) -> list[Word]:
        """Allocate the registers of the last three times, the latest first."""
        ages = ("last", "second to last", "third to last")
        return [d.word(f"{side} {age} {name} x10 ms", comment.format(age)) for age in ages]


class CarriedTags:
    """Relays and register of one arm that count the stems carried to the feed."""

    def __init__(self, side: str, index: int, stem: Expr, m: Area) -> None:
        self.stem = stem
        self.edge = m.bit("stem edge", "a stem has come into the beam, this scan")
        self.short = m.bit("carries too few", "more seedlings are missing in the claws than permitted, this scan")
        self.told = m.bit("short row told", "too few seedlings were carried to the feed with this row")
        self.missing = Word(
            "D", 174 + index, f"{side}.missing in claws", "seedlings missing in the row carried to feed"
        )


class PlantedTags:
    """Relays and registers of one row that count the cups without a plug behind the place of throwing."""

    def __init__(self, side: str, index: int, plug: Expr, m: Area) -> None:
        self.plug = plug
        self.edge = m.bit("plug edge", "a plug has come in front of the cup sensor, this scan")
        self.seen = m.bit("plug seen", "a plug has come in front of the cup sensor since the last cup")
        self.looks = m.bit("looks at row", "the cups of the last released row pass the cup sensor")
        self.short = m.bit("planted too few", "more cups of the released row are empty than permitted, this scan")
        self.empty = Word("D", 172 + index, f"{side}.empty in row", "empty cups of the last released row so far")
        self.empty_cups = Word(
            "D",
            565 + index,
            f"{side}.empty cups",
            "cups of released rows found empty since the last reset of the counts",
        )


class YieldTags:
    """Tags of the optional sensors of one arm that show whether its rows are held and planted.

    Attributes:
        pressure: Condition that air presses the fingers together; None without its sensor.
        carried: Count of the stems carried to the feed; None without its sensor.
        planted: Count of the empty cups behind the place of throwing; None without its sensor.
    """

    def __init__(self, side: str, index: int, x: Inputs) -> None:
        first = 178 + 100 * index
        stem, plug = x.optional(f"{side}.seedling_beam"), x.optional(f"{side}.cup_filled")
        self.pressure = x.optional(f"{side}.claw_pressure")
        self.planted = None if plug is None else PlantedTags(side, index, plug, Area("M", first, first + 9, side))
        self.carried = None if stem is None else CarriedTags(side, index, stem, Area("M", first + 10, first + 19, side))

    @property
    def counts(self) -> bool:
        """True if a sensor counts the seedlings of a row."""
        return self.carried is not None or self.planted is not None


class PlantingTags:
    """Relays, registers and timers of the planting speeds."""

    def __init__(self, io_map: IoMap, sides: Iterable[str]) -> None:
        m = Area("M", 330, 359, "planting")
        d = Area("D", 120, 149, "planting")
        t10 = Area("T", 237, 245, "planting")
        register = io_map.register("planter_speed")
        self.ground_sensor = Inputs(io_map).optional("ground_pulse")
        self.planter_speed = None if register is None else Word("D", register.number, register.tag, register.meaning)
        self.frequency = d.word("frequency x0.1/min", "planting frequency: cups per minute in each row")
        self.fastest = d.word(
            "fastest x0.1/min", "advice: highest planting frequency at which the arms keep up; 0 = not yet known"
        )
        self.gapless = d.word(
            "gapless x0.1/min",
            "advice: highest planting frequency without gaps after a wait for tray or other arm; 0 = no wait timed yet",
        )
        self.chain_speed = d.word("chain speed mm/s", "speed of the planter chain, from frequency and planter pitch")
        self.ground_speed = d.word("ground speed mm/s", "ground speed; 0 without a sensor or at standstill")
        self.ratio = d.word("lambda x0.01", "chain speed divided by ground speed; 0 = not known")
        self.longest = d.word("longest time x10 ms", "longest of the last times to prepare a row")
        self.longest_with_wait = d.word(
            "longest time with wait x10 ms",
            "longest of the last times to prepare a row, with or without waiting at feed",
        )
        self.cups = PulseTags("cups", 4, m, d, t10)
        self.ground = PulseTags("ground", 5, m, d, t10)
        self.ground_edge = m.bit("ground edge", "rising edge of the ground sensor")
        self.arms = {side: ReadinessTags(side, m, d, t10) for side in sides}
        self.cups_differ = m.bit("cups differ", "a left cup does not agree with the ground travel, this scan")
        self.cup_pulses = Counter(6, "planting.ground pulses of a cup", "pulses of the ground since the last left cup")
        self.t_too_fast = Timer(108, "planting.too fast", "planting faster than the arms")
        self.t_lambda = Timer(109, "planting.lambda", "lambda outside its limits")
