"""Set-points of the program: their devices, defaults and limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from controller.common.declarations import DeclarationError
from controller.common.suggestion import suggestion
from controller.core.expr import Bit, Word
from controller.program.areas import Area

CUPS: Final = 12
"""Cups that one throw of an arm fills."""

RELEASE_LEAD_X10_MS: Final = 25
"""Time from switching on the coil that opens the claws to the landing of the plugs. Valve, air and fingers take 126 ms
(simulated at 0.40 MPa) and the fall of 80 mm takes 128 ms, together 254 ms. With the input filter and the rounding of
the timers, the plugs land in the middle of their cups with 251 ms (simulated at 45 cups/min), rounded to whole units of
the timer (machine.yaml)."""

SLOWEST_PER_MIN: Final = 20
FASTEST_PER_MIN: Final = 90
"""Planting frequencies that the program serves with its default set-points, cups per minute in each row
(docs/sources/machine.md 1): below `SLOWEST_PER_MIN` rows are not released, above `FASTEST_PER_MIN` a pulse of the cups
is implausible."""
CUP_SHORTEST_X10_MS: Final = 63
"""Shortest permitted time from cup to cup: 0.667 s at `FASTEST_PER_MIN`, less 2 % for displaced flags and two scans."""
CUP_LONGEST_X10_MS: Final = 310
"""Longest time from cup to cup at which rows are released: 3 s at `SLOWEST_PER_MIN`, plus 2 % for displaced flags and
two scans. By hand, 21 to 25 seedlings per minute and row are fed (docs/sources/machine.md 1)."""
LONGEST_CUP_X10_MS: Final = 2_000
"""Longest measured time from cup to cup; a longer or unknown time counts as this one. Twelve times this time does not
exceed a register."""
ROWS_DIFFER_X10_MS: Final = 25
"""Largest difference between the times of the last cups of both rows at which a row is released. It is twice the
permitted change from cup to cup (`cups.SLOW_CHANGE_X10_MS`), because the cups of the other row have passed earlier by
up to one cup; a frequency that rises and falls within this cup can make it larger. If the cups of one row are even, and
those of the other one are shorter by more, the other one counts twice."""
GROUND_PER_CUP_LEAST: Final = 6
"""Least number of ground pulses from cup to cup: the drive wheel travels 0.40 m, eight pulses, from cup to cup. If both
rows are counted twice, there are four."""
GROUND_PER_CUP_MOST: Final = 14
"""Largest number of ground pulses from cup to cup, with 40 % slip of the drive wheel. If every second cup of both rows
is missed, there are sixteen."""

MISSING_MOST: Final = 5
"""Largest number of seedlings missing in a row of twelve with which work continues. In the paper, 94.6 % of the
seedlings are planted, so that a missing one in a row is usual, and six occur by chance once in 58,000 rows, which both
arms plant in 130 h at 45 cups per minute. A fault of claws, air or tray usually empties the complete row."""

SLIDE_LEAST_X10_MS: Final = 90
"""Shortest plausible travel time from the switch of row 1 to the feed switch. 180 mm (192.5 mm less both switch bands)
take 1.2 s at 0.15 m/s; the value is three quarters of that. A different row spacing requires a different value
(machine.yaml)."""

GROUND_PULSE_MM: Final = 50
"""Travel per pulse of the ground sensor. At 2.5 km/h a pulse takes 72 ms, so that each level lasts longer than the
input filter (10 ms) plus a scan (20 ms). With twice the distance, a measurement of 20 pulses would require 2 m."""
PLANTER_PITCH_MM: Final = 489
"""Distance between the planters on the chain, computed from 456.7 mm/s at 56 plants per minute in the simulated cases
of Du et al. (docs/sources/plant.md)."""

ROW_PITCH_MM: Final = 43.0
FINGER_OVERHANG_MM: Final = 25.0
"""Inward reach of the fingers past the stems: half of the 50 mm spring strip (paper), which is assumed to grip
at its middle."""
ARMS_MAY_MEET: Final = int(2 * FINGER_OVERHANG_MM < ROW_PITCH_MM)
"""1 if both arms may be at row 3 at the same time. They are then one row pitch apart, and their fingers must not
overlap."""

LONGEST_NUMBER: Final = 9
"""Maximum number of digits in a set-point value."""
LIST: Final = "docs/reference/commands.md"
"""Page with all set-points."""


class SetPointError(ValueError):
    """Raised for an unknown set-point or an invalid value; the message is one line."""


class SetPoints:
    """Words that the operator or a start may change, with defaults. Times of 10 ms timers are in units of 10 ms."""

    def __init__(self, *, counts_seedlings: bool = False) -> None:
        """Declare the set-points.

        Args:
            counts_seedlings: True if a sensor is wired that counts the seedlings of a row.
        """
        d, m = Area("D", 512, 539), Area("M", 380, 389)
        self.defaults: list[tuple[Word, int]] = []

        self.limits: dict[Word, tuple[int, int]] = {}
        self.constants: list[Word] = []
        """Machine constants: set-points that an interlock, a place or an assumption of the proof relies on. They are
        given at each start, are not retained, and do not change while the controller runs."""
        self.differs: dict[Word, Bit] = {}
        """Relay of each machine constant: its value differs from the default."""

        def add(name: str, default: int, lowest: int, highest: int, comment: str, *, constant: bool = False) -> Word:
            __tracebackhide__ = True
            if not lowest <= default <= highest:
                raise DeclarationError(f"set-point {name!r}: default {default} is not within {lowest} to {highest}")
            word = d.word(name, comment)
            self.defaults.append((word, default))
            self.limits[word] = (lowest, highest)
            if constant:
                self.constants.append(word)
                self.differs[word] = m.bit(f"{name} differs", f"machine constant {name} differs from its default")
            return word

        self.trays_target = add("trays target", 0, 0, 1000, "number of trays to empty before Complete; 0 = no limit")
        self.step_sequence = add(
            "step sequence", 1, 1, 3, "sequence to step in step mode: 1 left arm, 2 right arm, 3 tray feeder"
        )
        self.descend_at_count = add(
            "descend at count", 0, 0, CUPS, "cup count at which the arm moves down over the cups"
        )
        self.converge_at = add("converge at", 0, 0, 1, "0 = converge with the arm down, 1 = move up first")
        self.arms_may_meet = add(
            "arms may meet",
            ARMS_MAY_MEET,
            0,
            1,
            "1 = both arms may be inward of pick 2 at the same time",
            constant=True,
        )
        self.release_delay = add(
            "release delay x10 ms",
            0,
            0,
            100,
            "delay from the releasing cup pulse to opening; 0 = measured",
        )
        self.no_cups = add(
            "no cups x100 ms",
            40,
            10,
            6000,
            "waiting time without a cup pulse before suspending; default: 3 cup intervals",
        )
        self.pulse_interval = add("cup pulse interval x10 ms", 25, 5, 200, "shortest time between two cup pulses")
        self.settle = add("settle x10 ms", 10, 5, 200, "time the slide must stay on its switch before clamping")
        self.clamp = add("clamp x10 ms", 20, 10, 200, "claw closing dwell", constant=True)
        self.release = add("release x10 ms", 20, 10, 200, "claw opening dwell", constant=True)
        self.pause_at_feed = add(
            "pause at feed x10 ms", 50, 0, 500, "delay from arrival at feed to spreading (paper: 0.5 s)"
        )
        self.tray_index = add("tray index x10 ms", 10, 1, 200, "time at full speed into the gap before creeping")
        self.slide_least = add(
            "slide least x10 ms",
            SLIDE_LEAST_X10_MS,
            10,
            500,
            "shortest plausible travel time between a row and feed",
            constant=True,
        )
        self.no_tray = add("no tray x100 ms", 120, 10, 3000, "creep time without a front edge before suspending")
        self.release_lead = add(
            "release lead x10 ms",
            RELEASE_LEAD_X10_MS,
            0,
            100,
            "time from opening the claws to landing; they open this long before a cup is under them",
        )
        self.ground_pulse = add("ground pulse mm", GROUND_PULSE_MM, 10, 500, "travel per pulse of the ground sensor")
        self.planter_pitch = add("planter pitch mm", PLANTER_PITCH_MM, 50, 2000, "distance between two planters")
        self.lambda_lowest = add("lowest lambda x0.01", 100, 10, 300, "lambda below which a warning is given")
        self.lambda_highest = add("highest lambda x0.01", 160, 10, 300, "lambda above which a warning is given")
        self.planter_lambda = add(
            "planter lambda x0.01", 117, 10, 300, "lambda of a planter with its own motor and a ground speed sensor"
        )
        self.planter_speed = add(
            "planter speed mm/s",
            0,
            0,
            2000,
            "chain speed of a planter with its own motor if no ground sensor is wired",
        )
        self.cup_time_shortest = add(
            "cup time shortest x10 ms",
            CUP_SHORTEST_X10_MS,
            20,
            300,
            "shortest permitted time from cup to cup; default: 90 per minute less the tolerance",
        )
        self.cup_time_longest = add(
            "cup time longest x10 ms",
            CUP_LONGEST_X10_MS,
            60,
            1000,
            "longest time from cup to cup at which rows are released; default: 20 per minute plus the tolerance",
        )
        self.ground_pulses_least = add(
            "ground pulses least", GROUND_PER_CUP_LEAST, 0, 100, "least number of ground pulses from cup to cup"
        )
        self.ground_pulses_most = add(
            "ground pulses most", GROUND_PER_CUP_MOST, 1, 1000, "largest number of ground pulses from cup to cup"
        )

        self.missing_most: Word | None = None
        if counts_seedlings:
            d, m = Area("D", 567, 569), Area("M", 198, 199)
            self.missing_most = add(
                "missing seedlings most",
                MISSING_MOST,
                0,
                CUPS,
                "largest number of seedlings missing in a row with which work continues; 12 = any number",
                constant=True,
            )

    def names(self) -> list[str]:
        """Return the attribute names of all set-points."""
        return [name for name, value in vars(self).items() if isinstance(value, Word)]

    def changed(self, read: Callable[[Word], int]) -> dict[str, tuple[int, int]]:
        """Return the present and the default value of each constant that differs from its default, by name."""
        defaults = dict(self.defaults)
        names = {getattr(self, name): name for name in self.names()}
        values = {word: read(word) for word in self.constants}
        return {names[word]: (value, defaults[word]) for word, value in values.items() if value != defaults[word]}

    def checked(self, name: str, text: str) -> tuple[Word, int]:
        """Return the word of a set-point and the value parsed from text.

        Raises:
            SetPointError: The set-point is unknown, or the value is not an integer or is out of range.
        """
        if name not in self.names():
            remedy = suggestion(name, self.names(), default=f"{LIST} lists all")
            raise SetPointError(f"unknown set-point {name!r}; {remedy}")
        word: Word = getattr(self, name)
        lowest, highest = self.limits[word]
        if not text.isdecimal():
            raise SetPointError(f"must be an integer, {lowest} to {highest}")
        if len(text) > LONGEST_NUMBER:
            raise SetPointError(f"must be {lowest} to {highest}")
        if not lowest <= int(text) <= highest:
            raise SetPointError(f"must be {lowest} to {highest}")
        return word, int(text)

    def changes(self, values: Mapping[str, str]) -> list[tuple[Word, int]]:
        """Return the words and new values of set-points that change while the controller runs.

        Raises:
            SetPointError: A set-point is unknown or a machine constant, or a value is out of range.
        """
        changes = [self.checked(name, value) for name, value in values.items()]
        if any(word in self.constants for word, _ in changes):
            raise SetPointError(
                "a machine parameter cannot change while the controller runs; set it at start-up with --set"
            )
        return changes
