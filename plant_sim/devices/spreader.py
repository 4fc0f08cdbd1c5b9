"""The spreader: a DC motor with a belt that sets the pitch of the claws."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from plant_sim.devices.sensor import SENSOR, SENSOR_MAKE, Sensor, place_switch, step_switch
from plant_sim.devices.view import View
from plant_sim.pneumatics.compiled import compiled
from plant_sim.pneumatics.friction import FRICTION, rubbed_m_s
from plant_sim.spec import require, require_within

#: State: belt travel and speed of the claws, speed of the motor at the belt; switches: converged, spread.
SPREADER = np.dtype([("travel_m", "f8"), ("speed_m_s", "f8"), ("motor_m_s", "f8"), ("switches", SENSOR, (2,))])

#: What it is, everything reduced to the belt. `slips_n` is the force above which the belt slips.
SPREADER_MAKE = np.dtype(
    [
        ("full_m", "f8"),
        ("voltage_v", "f8"),
        ("resistance_ohm", "f8"),
        ("emf_v_s_m", "f8"),
        ("motor_kg", "f8"),
        ("load_kg", "f8"),
        ("slips_n", "f8"),
        ("blocked", "i8"),
        ("friction", FRICTION),
        ("switches", SENSOR_MAKE, (2,)),
    ]
)


@dataclass(frozen=True, slots=True)
class SpreaderSpec:
    """What is bolted to the machine; motor and claws reduced to the belt.

    Attributes:
        travel_m: Belt travel of the front claw from converged to spread, m.
        voltage_v: Supply of the motor, V; with neither direction on, its relay shorts it: it brakes.
        resistance_ohm: Armature, ohm.
        emf_v_s_m: Voltage the motor gives at a belt speed of 1 m/s, V s/m; also its force, N/A.
        motor_kg: Inertia of motor and gear at the belt, kg.
        claws_kg: Inertia of the moved claws at the belt, kg.
        friction_n: Friction of guides and chain at the belt, N.
        slips_n: Force at which the belt slips, N.
        switch_band_m: How near to its end an end switch comes on, m.
        switch_hysteresis_m: How far beyond the band it goes off, m.
    """

    travel_m: float
    voltage_v: float
    resistance_ohm: float
    emf_v_s_m: float
    motor_kg: float
    claws_kg: float
    friction_n: float
    slips_n: float
    switch_band_m: float
    switch_hysteresis_m: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.01, 1.0, "travel_m")
        require_within(self, 1.0, 400.0, "voltage_v")
        require_within(self, 0.01, 100.0, "resistance_ohm")
        require_within(self, 1.0, 2000.0, "emf_v_s_m")
        require_within(self, 0.1, 500.0, "motor_kg", "claws_kg")
        require_within(self, 0.0, 500.0, "friction_n")
        require_within(self, 1.0, 5000.0, "slips_n")
        require_within(self, 0.0, 0.02, "switch_band_m")
        require_within(self, 0.0, 0.005, "switch_hysteresis_m")
        reach_m = self.switch_band_m + self.switch_hysteresis_m
        require(2 * reach_m < self.travel_m, "switch_band_m", "lets both end switches be on at once")
        stall_n = self.emf_v_s_m * self.voltage_v / self.resistance_ohm
        require(self.friction_n < stall_n, "friction_n", f"holds the motor, which gives {stall_n:.4g} N at most")

    @property
    def speed_m_s(self) -> float:
        """Steady belt speed, m/s: where the motor's force is the friction."""
        return (self.voltage_v - self.friction_n * self.resistance_ohm / self.emf_v_s_m) / self.emf_v_s_m


@compiled
def step_spreader(s: Any, make: Any, spread: bool, converge: bool, at_s: float, step_s: float) -> None:
    """Let time pass.

    Args:
        s: The spreader.
        make: What it is.
        spread: Motor towards cup pitch; with both directions on the motor is shorted.
        converge: Motor towards tray pitch.
        at_s: Start of the step, s.
        step_s: Length of the step, s.
    """
    drive = (1.0 if spread else 0.0) - (1.0 if converge else 0.0)
    before_m = s.travel_m
    if drive != 0.0 or s.speed_m_s != 0.0 or s.motor_m_s != 0.0:
        _turn(s, make, drive, step_s)
        travel_m = before_m + step_s * s.speed_m_s
        s.travel_m = min(max(travel_m, 0.0), make.full_m)
        if s.travel_m != travel_m:  # the end stop takes the speed of the claws, and of the motor unless the belt slips
            s.speed_m_s = 0.0
    for number in range(2):
        step_switch(s.switches[number], make.switches[number], before_m, s.travel_m, at_s, step_s)


@compiled
def _turn(s: Any, make: Any, drive: float, step_s: float) -> None:
    """New speeds of motor and claws; the belt joins them up to its force."""
    push_n = drive * make.voltage_v * make.emf_v_s_m / make.resistance_ohm
    brake = make.emf_v_s_m * make.emf_v_s_m / make.resistance_ohm
    both_kg = make.motor_kg + make.load_kg
    common_m_s = (make.motor_kg * s.motor_m_s + make.load_kg * s.speed_m_s) / both_kg
    together_m_s = 0.0
    push_out = common_m_s + step_s * push_n / both_kg
    at_end = (s.travel_m >= make.full_m and push_out > 0.0) or (s.travel_m <= 0.0 and push_out < 0.0)
    stands = make.blocked != 0 or at_end
    if not stands:
        free_m_s = (common_m_s + step_s * push_n / both_kg) / (1.0 + step_s * brake / both_kg)
        # the motor's own braking makes the mass seem larger to the friction
        together_m_s = rubbed_m_s(make.friction, free_m_s, common_m_s, both_kg + step_s * brake, step_s)
    belt_n = push_n - brake * together_m_s - make.motor_kg * (together_m_s - s.motor_m_s) / step_s
    if abs(belt_n) <= make.slips_n:
        s.motor_m_s = together_m_s
        s.speed_m_s = together_m_s
        return
    pull_n = math.copysign(make.slips_n, belt_n)
    s.motor_m_s = (s.motor_m_s + step_s * (push_n - pull_n) / make.motor_kg) / (1.0 + step_s * brake / make.motor_kg)
    if stands:
        s.speed_m_s = 0.0
    else:
        free_m_s = s.speed_m_s + step_s * pull_n / make.load_kg
        s.speed_m_s = rubbed_m_s(make.friction, free_m_s, s.speed_m_s, make.load_kg, step_s)


class Spreader(View):
    """A view of one spreader. Inputs: the two directions of the motor; both at once brake it.

    Attributes:
        converged_switch: End switch at tray pitch.
        spread_switch: End switch at cup pitch.
    """

    __slots__ = ("converged_switch", "spread_switch")

    def __init__(self, spec: SpreaderSpec, state: Any, make: Any, *, bounce_s: float) -> None:
        """Build it, converged, at rest.

        Args:
            spec: What it is.
            state: Its record, `SPREADER`.
            make: Its record, `SPREADER_MAKE`.
            bounce_s: For how long a closing contact bounces, s.
        """
        super().__init__(state, make)
        values = {
            "full_m": spec.travel_m,
            "voltage_v": spec.voltage_v,
            "resistance_ohm": spec.resistance_ohm,
            "emf_v_s_m": spec.emf_v_s_m,
            "motor_kg": spec.motor_kg,
            "load_kg": spec.claws_kg,
            "slips_n": spec.slips_n,
        }
        for name, value in values.items():
            make[name] = value
        make["friction"] = (spec.friction_n, spec.friction_n, 1.0, 0.0)
        for switch, at_m in zip(make["switches"], (0.0, spec.travel_m), strict=True):
            switch["at_m"], switch["forced"] = at_m, -1
            switch["band_m"], switch["hysteresis_m"] = spec.switch_band_m, spec.switch_hysteresis_m
            switch["bounce_s"] = bounce_s
        self.converged_switch, self.spread_switch = (
            Sensor(state["switches"][number], make["switches"][number]) for number in range(2)
        )
        self.place(0.0)

    @property
    def travel_m(self) -> float:
        """Belt travel, m: 0 is converged (tray pitch), the full travel is spread (cup pitch)."""
        return float(self.state["travel_m"])

    @property
    def speed_m_s(self) -> float:
        """Speed of the claws at the belt, m/s, positive while spreading."""
        return float(self.state["speed_m_s"])

    def place(self, travel_m: float) -> None:
        """Put the claws somewhere, at rest: a starting situation, not a motion.

        Args:
            travel_m: Where, m; clipped to the travel.
        """
        state, make = self.state, self.make
        state["travel_m"] = min(max(travel_m, 0.0), float(make["full_m"]))
        state["speed_m_s"] = state["motor_m_s"] = 0.0
        for number in range(2):
            place_switch(state["switches"][number], make["switches"][number], float(state["travel_m"]))
