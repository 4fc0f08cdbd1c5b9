"""Live view of the page as JSON, built from the mirror; sent in full once, then as deltas."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from controller.core.devices import device_name
from controller.core.expr import Bit, Word
from controller.events.alarm_load import is_chattering, is_standing
from controller.hmi.access import status_registers as status
from controller.hmi.panel.modbus import mirror as registers
from controller.hmi.panel.modbus.mirror import Mirror
from controller.hmi.panel.modbus.telemetry import Telemetry
from controller.hmi.panel.orders.jog import Jogging
from controller.hmi.panel.orders.jog_reasons import jog_obstacle
from controller.hmi.panel.orders.session import force_obstacle, obstacle_text
from controller.hmi.panel.view.facts import Json, MachineFacts
from controller.program.machine import Transplanter
from controller.program.operator.answers import Question
from controller.program.operator.commands import JOGGED
from controller.program.operator.next_press import NextPress, answering, named_commands, refused_text, what_to_do
from controller.program.operator.refusals import Refusal
from controller.program.tags import SIDES, Side
from controller.program.texts.isolation import begins_with_isolation
from controller.program.texts.next_press import NEXT_PRESSES
from controller.program.texts.operator import Text

OPEN_KEYS: Final = ("steps",)
"""Sections with a variable set of keys: in a delta, null marks a removed key."""


class ViewBuilder:
    """Builder of the live view."""

    def __init__(
        self,
        machine: Transplanter,
        mirror: Mirror,
        jogging: Jogging,
        telemetry: Telemetry | None = None,
        newest_alarm: Callable[[], int | None] = lambda: None,
    ) -> None:
        """Initialise a builder with its data sources.

        Args:
            machine: The program and its tags.
            mirror: Mirror of the controller.
            jogging: Jog state.
            telemetry: Telemetry source, if configured.
            newest_alarm: Function that returns the number of the newest change of an alarm in the history; None = no
                history.
        """
        self._machine = machine
        self._tags = machine.tags
        self._facts = MachineFacts(machine)
        self._mirror = mirror
        self._jogging = jogging
        self._telemetry = telemetry
        self._newest_alarm = newest_alarm
        self._steps = [bit for sequence in machine.program.sequences() for bit, _ in sequence]
        self._by_number = {command.number: command for command in machine.tags.commands}
        names = {command.bit: command.name for command in machine.tags.commands}
        answers = {answering(question) for question in Question}
        self._next_commands: dict[int, str] = {
            press: names[bits[0]] for press, bits in named_commands(machine.tags).items() if press not in answers
        }

    def view(self) -> Json:
        """Return all sections except `me`, which is specific to each browser."""
        telemetry = self._telemetry
        return {
            "link": self._link(),
            "machine": self._control(),
            "arms": {side: self._arm(side) for side in SIDES},
            "tray": self._facts.tray(self._mirror.memory),
            "io": self._facts.io(self._mirror.memory),
            "forced": self._forced(),
            "steps": {str(bit): 1 for bit in self._steps if self._read(bit)},
            "alarms": {
                "rows": list(self._alarms()),
                "recent": self._mirror.word(status.R_ALARMS_RECENT),
                "peak": self._mirror.word(status.R_ALARMS_PEAK),
            },
            "questions": {"open": [key for key, asked in self._questions() if self._read(asked)]},
            "commands": dict(self._commands()),
            "set_points": {name: self._read(getattr(self._tags.sp, name)) for name in self._tags.sp.names()},
            "telemetry": {} if telemetry is None else telemetry.values,
            "jog": self._jog(),
        }

    def _read(self, device: Bit | Word) -> int:
        memory = self._mirror.memory
        if isinstance(device, Bit):
            return int(memory.bits(device.kind)[device.number])
        return memory.word(device.kind, device.number)

    def _link(self) -> Json:
        mirror, telemetry = self._mirror, self._telemetry
        simulated, pace = bool(mirror.word(registers.R_SIMULATED)), mirror.word(registers.R_PACE_PERCENT)
        return {
            "controller": mirror.connected,
            "age_ms": mirror.age_ms,
            "telemetry": telemetry is not None and telemetry.fresh,
            "telemetry_age_ms": None if telemetry is None else telemetry.age_ms,
            "field_lost": bool(mirror.word(registers.R_LINK_LOST)),
            "paused": simulated and pace == 0,
            "simulated": simulated,
            "pace_percent": pace,
            "forcing_allowed": bool(mirror.word(registers.R_FORCING_ALLOWED)),
            "force_why": in_both_or_none(force_obstacle(self._tags, mirror)),
            "history": self._newest_alarm() is not None,
            "newest_alarm": self._newest_alarm(),
        }

    def _control(self) -> Json:
        machine = self._tags.machine
        line = what_to_do(self._tags, (), self._read) or NEXT_PRESSES[NextPress.NONE]  # the banner names the alarm
        return {
            "state": self._read(machine.state),
            "mode": self._read(machine.mode),
            "reason": self._read(machine.reason),
            "first_out": self._read(machine.first_out),
            "trays_done": self._read(machine.trays_done),
            "refusals": self._read(machine.refusals),
            "refusal": self._refusal(),
            "next": in_both(line),
            "isolate": begins_with_isolation(line),
            "next_press": self._read(machine.next_press),
            "next_command": self._next_command(),
            "cups_per_min": self._read(self._tags.planting.frequency) / 10,
            "rows_left": self._read(machine.rows_left),
            "time_ms": self._mirror.long(status.R_TIME_MS),
        }

    def _next_command(self) -> str | None:
        """Return the name of the command that the next press gives; None if it gives none, or answers a question."""
        return self._next_commands.get(self._read(self._tags.machine.next_press))

    def _jog(self) -> Json:
        """Return the output that is jogged, and why it stays off or moves nothing."""
        output, why = self._jogging.output, None
        is_requested = output is not None and self._read(self._tags.machine.jog) == 1 + JOGGED.index(output)
        if output is not None and is_requested:
            why = jog_obstacle(self._machine, self._mirror.memory, output)
        return {"output": output, "requested": is_requested, "why": in_both_or_none(why)}

    def _refusal(self) -> Json | None:
        machine = self._tags.machine
        command, reason = self._by_number.get(self._read(machine.refused)), self._read(machine.refusal)
        if command is None or reason not in set(Refusal):
            return None
        return in_both(refused_text(command, Refusal(reason), what_to_do(self._tags, self._machine.alarms, self._read)))

    def _arm(self, side: Side) -> Json:
        first = status.R_CYCLES + status.CYCLE_WORDS * SIDES.index(side)
        cause = self._mirror.word(first + 6)
        return self._facts.arm(self._mirror.memory, side) | {
            "cycle_ms": self._mirror.long(first + 2),
            "waiting_ms": self._mirror.long(first + 4),
            "gap_cause": status.GAP_CAUSES[cause] if cause < len(status.GAP_CAUSES) else status.GAP_CAUSES[0],
        }

    def _forced(self) -> list[str]:
        forced = self._mirror.long(registers.R_FORCED)
        return [device_name("X", number) for number in range(32) if forced >> number & 1]

    def _alarms(self) -> Iterator[Json]:
        mirror = self._mirror
        now_ms = mirror.long(status.R_TIME_MS)
        for row in range(status.ALARM_ROWS):
            first = status.R_ALARMS + status.ALARM_WORDS * row
            number, state = mirror.word(first), mirror.word(first + 1)
            if number and state < len(status.ALARM_STATES):
                came_ms = mirror.long(first + 4)
                activations = mirror.word(status.R_ALARM_ACTIVATIONS + row)
                yield {
                    "number": number,
                    "state": state,
                    "first_out": bool(mirror.word(first + 2)),
                    "follows": mirror.word(first + 3) or None,
                    "chattering": is_chattering(activations, came_ms, now_ms),
                    "standing": is_standing(status.ALARM_STATES[state], came_ms, now_ms),
                    "came_ms": came_ms,
                    "shelved_until_ms": mirror.long(first + 6) or None,
                }

    def _questions(self) -> Iterator[tuple[str, Bit]]:
        for side, arm in self._tags.arms.items():
            yield f"{side}_loaded", arm.ask
            yield f"{side}_cups", arm.ask_cups
        yield "tray", self._tags.tray.ask

    def _commands(self) -> Iterator[tuple[str, Json]]:
        for command in self._tags.commands:
            reason = obstacle_text(self._machine, self._mirror.memory, command)
            yield command.name, {"free": reason is None, "why": in_both_or_none(reason)}


def in_both(text: Text) -> Json:
    """Return a text as JSON.

    Examples:
        >>> in_both(Text("left", "左"))
        {'en': 'left', 'zh': '左'}
    """
    return {"en": text.en, "zh": text.zh}


def in_both_or_none(text: Text | None) -> Json | None:
    """Return a text as JSON; None if there is none."""
    return None if text is None else in_both(text)


def delta(before: Mapping[str, Any], after: Mapping[str, Any]) -> Json:
    """Return the changes between two views: the changed keys of each section.

    A section that is not an object is sent in full; in the sections of `OPEN_KEYS`, null marks a removed key.

    Examples:
        >>> delta({"steps": {"S20": 1}, "forced": []}, {"steps": {"S21": 1}, "forced": ["X5"]})
        {'steps': {'S21': 1, 'S20': None}, 'forced': ['X5']}
    """
    changes: Json = {}
    for section, new in after.items():
        old = before.get(section)
        if old == new and section in before:
            continue
        if not isinstance(new, dict) or not isinstance(old, dict):
            changes[section] = new
            continue
        changes[section] = {key: value for key, value in new.items() if key not in old or old[key] != value}
        if section in OPEN_KEYS:
            changes[section] |= dict.fromkeys(old.keys() - new.keys())
    return changes
