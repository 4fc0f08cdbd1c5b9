"""Binary sensors, each of which can be forced as a fault."""


class Sensor:
    """A binary sensor.

    Attributes:
        stuck: None while it is sound; True or False is what it says whatever it sees.
    """

    __slots__ = ("_on", "stuck")

    def __init__(self) -> None:
        """Start sound and off."""
        self._on = False
        self.stuck: bool | None = None

    def sense(self, on: bool) -> None:
        """Take note of what is there to be seen."""
        self._on = on

    def read(self) -> bool:
        """Whether the sensor says on."""
        return self._on if self.stuck is None else self.stuck


class PositionSwitch(Sensor):
    """A switch that is on near one position of a moving part.

    It comes on when the part is within the band, and goes off when the part has left the band by
    more than the hysteresis.

    >>> switch = PositionSwitch(0.100, band_m=0.005, hysteresis_m=0.001, position_m=0.094)
    >>> seen = []
    >>> for position_m in (0.0955, 0.1045, 0.1055, 0.1065, 0.1055):
    ...     switch.update(position_m)
    ...     seen.append(switch.read())
    >>> seen
    [True, True, True, False, False]
    """

    __slots__ = ("_at_m", "_off_beyond_m", "_on_within_m")

    def __init__(self, at_m: float, *, band_m: float, hysteresis_m: float, position_m: float) -> None:
        """Mount the switch.

        Args:
            at_m: Where it is mounted, m.
            band_m: Half width of the band in which it comes on, m.
            hysteresis_m: How far beyond the band it goes off, m.
            position_m: Where the moving part is now, m.
        """
        super().__init__()
        self._at_m = at_m
        self._on_within_m = band_m
        self._off_beyond_m = band_m + hysteresis_m
        self.update(position_m)

    def update(self, position_m: float) -> None:
        """See the moving part at a position, m."""
        reach_m = self._off_beyond_m if self._on else self._on_within_m
        self._on = abs(position_m - self._at_m) <= reach_m
