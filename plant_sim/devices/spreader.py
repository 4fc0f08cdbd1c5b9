"""Spreader: a DC motor with a belt that sets the pitch of the claws."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled
from plant_sim.common.limits import require, require_within
from plant_sim.devices.sensor import SENSOR, SENSOR_PARAMS, Sensor, place_switch, step_switch
from plant_sim.devices.view import View
from plant_sim.pneumatics.friction import FRICTION, speed_after_friction_m_s

SPREADER = np.dtype([("travel_m", "f8"), ("speed_m_s", "f8"), ("motor_m_s", "f8"), ("switches", SENSOR, (2,))])
"""State: belt travel and speed of the claws, motor speed at the belt; switches: converged, spread."""

SPREADER_PARAMS = np.dtype(
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
        ("switches", SENSOR_PARAMS, (2,)),
    ]
)
"""Parameters, all referred to the belt. `slips_n` is the force above which the belt slips."""


@dataclass(frozen=True, slots=True)
class SpreaderSpec:
    """Parameters of a spreader; the values of motor and claws are referred to the belt.

    Attributes:
        travel_m: Belt travel of the front claw from converged to spread, m.
        voltage_v: Supply voltage, V; if neither direction is on, a relay short-circuits the motor to brake it.
        resistance_ohm: Armature resistance, ohm.
        emf_v_s_m: Back-EMF at a belt speed of 1 m/s, V s/m; also the motor force per unit of current, N/A.
        motor_kg: Inertia of motor and gear at the belt, kg.
        claws_kg: Inertia of the moved claws at the belt, kg.
        friction_n: Friction of guides and chain at the belt, N.
        slips_n: Force at which the belt slips, N.
        switch_band_m: Distance from the end within which an end switch turns on, m.
        switch_hysteresis_m: Distance beyond the band at which it turns off, m.
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
        """Validate the parameters."""
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
        require(2 * reach_m < self.travel_m, "switch_band_m", "lets both end switches be on at the same time")
        stall_n = self.emf_v_s_m * self.voltage_v / self.resistance_ohm
        require(self.friction_n < stall_n, "friction_n", f"exceeds the stall force of the motor, {stall_n:.4g} N")

    @property
    def speed_m_s(self) -> float:
        """Steady belt speed, at which motor force and friction balance, m/s."""
        return (self.voltage_v - self.friction_n * self.resistance_ohm / self.emf_v_s_m) / self.emf_v_s_m


@compiled
def step_spreader(s: Any, params: Any, spread: bool, converge: bool, at_s: float, step_s: float) -> None:
    """Advance by one time step.

    Args:
        s: The spreader.
        params: Its parameters.
        spread: True drives towards cup pitch; both directions together short-circuit the motor.
        converge: True drives towards tray pitch.
        at_s: Start of the step, s.
        step_s: Length of the step, s.
    """
    drive = (1.0 if spread else 0.0) - (1.0 if converge else 0.0)
    before_m = s.travel_m
    if drive != 0.0 or s.speed_m_s != 0.0 or s.motor_m_s != 0.0:
        _turn(s, params, drive, step_s)
        travel_m = before_m + step_s * s.speed_m_s
        s.travel_m = min(max(travel_m, 0.0), params.full_m)
        if s.travel_m != travel_m:  # an end stop absorbs the claw speed, and the motor speed unless the belt slips
            s.speed_m_s = 0.0
    for number in range(2):
        step_switch(s.switches[number], params.switches[number], before_m, s.travel_m, at_s, step_s)


@compiled
def _turn(s: Any, params: Any, drive: float, step_s: float) -> None:
    """Update the speeds of motor and claws, which the belt couples up to its slip force."""
    push_n = drive * params.voltage_v * params.emf_v_s_m / params.resistance_ohm
    brake = params.emf_v_s_m * params.emf_v_s_m / params.resistance_ohm
    both_kg = params.motor_kg + params.load_kg
    common_m_s = (params.motor_kg * s.motor_m_s + params.load_kg * s.speed_m_s) / both_kg
    together_m_s = 0.0
    push_out = common_m_s + step_s * push_n / both_kg
    at_end = (s.travel_m >= params.full_m and push_out > 0.0) or (s.travel_m <= 0.0 and push_out < 0.0)
    is_held = params.blocked != 0 or at_end
    if not is_held:
        free_m_s = (common_m_s + step_s * push_n / both_kg) / (1.0 + step_s * brake / both_kg)
        # motor braking increases the effective mass on which friction acts
        together_m_s = speed_after_friction_m_s(params.friction, free_m_s, common_m_s, both_kg + step_s * brake, step_s)
    belt_n = push_n - brake * together_m_s - params.motor_kg * (together_m_s - s.motor_m_s) / step_s
    if abs(belt_n) <= params.slips_n:
        s.motor_m_s = together_m_s
        s.speed_m_s = together_m_s
        return
    pull_n = math.copysign(params.slips_n, belt_n)
    s.motor_m_s = (s.motor_m_s + step_s * (push_n - pull_n) / params.motor_kg) / (
        1.0 + step_s * brake / params.motor_kg
    )
    if is_held:
        s.speed_m_s = 0.0
    else:
        free_m_s = s.speed_m_s + step_s * pull_n / params.load_kg
        s.speed_m_s = speed_after_friction_m_s(params.friction, free_m_s, s.speed_m_s, params.load_kg, step_s)


class Spreader(View):
    """View of one spreader. Inputs: the two motor directions; both together brake the motor.

    Attributes:
        converged_switch: End switch at tray pitch.
        spread_switch: End switch at cup pitch.
    """

    __slots__ = ("converged_switch", "spread_switch")

    def __init__(self, spec: SpreaderSpec, state: Any, params: Any, *, bounce_s: float) -> None:
        """Initialise the spreader at rest in the converged position.

        Args:
            spec: Parameters of the spreader.
            state: Its state record, `SPREADER`.
            params: Its parameter record, `SPREADER_PARAMS`.
            bounce_s: Bounce time of a closing contact, s.
        """
        super().__init__(state, params)
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
            params[name] = value
        params["friction"] = (spec.friction_n, spec.friction_n, 1.0, 0.0)
        for switch, at_m in zip(params["switches"], (0.0, spec.travel_m), strict=True):
            switch["at_m"], switch["forced"] = at_m, -1
            switch["band_m"], switch["hysteresis_m"] = spec.switch_band_m, spec.switch_hysteresis_m
            switch["bounce_s"] = bounce_s
        self.converged_switch, self.spread_switch = (
            Sensor(state["switches"][number], params["switches"][number]) for number in range(2)
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
        """Set the position of the claws at rest as an initial condition, without motion.

        Args:
            travel_m: Belt travel, m; clipped to the full travel.
        """
        state, params = self.state, self.params
        state["travel_m"] = min(max(travel_m, 0.0), float(params["full_m"]))
        state["speed_m_s"] = state["motor_m_s"] = 0.0
        for number in range(2):
            place_switch(state["switches"][number], params["switches"][number], float(state["travel_m"]))
