"""Reader of scenario files; a file is checked completely before the run starts."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from controller.common.modbus.io_map import IoMap
from controller.common.suggestion import suggestion
from controller.common.yaml_section import Section, one_of, read_section, whole
from controller.core.expr import Word
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import Transplanter, build
from controller.program.states import State
from plant_sim.common.parameter_file import Value
from plant_sim.common.units import parse_ms, parse_quantity, unit_of
from plant_sim.faults import Fault, FaultError, FaultSchedule, parse_size
from plant_sim.machine.parameters import Machine, MachineError, load_machine
from plant_sim.machine.plant import Plant
from plant_sim.scenario.actions import VERBS, CheckContext
from plant_sim.scenario.checks import read_checks
from plant_sim.scenario.errors import ScenarioError
from plant_sim.scenario.run import Action, Scenario, Until, When

SCENARIOS = Path(__file__).with_name("library")

_KEYS = ("title", "seed", "trays", "machine", "set_points", "faults", "actions", "until", "expect")
_FAULT_KEYS = ("kind", "at", "from", "until", "size")
_WHEN_KEYS = ("at", "after")
_DEFAULT_ACTIONS = (("0.1 s", "start"), ("IDLE", "start"))
"""Buttons pressed in a scenario that has no actions: home, then start."""


def find_scenario(name: str) -> Path:
    """Return the path of a scenario file.

    Args:
        name: Path, or name of a scenario of the library.

    Raises:
        ScenarioError: There is no such file or scenario.
    """
    path = Path(name)
    shipped = {file.stem: file for file in sorted(SCENARIOS.glob("*.yaml"))}
    if name in shipped and not path.is_file():
        return shipped[name]
    if path.suffix or path.exists():
        return path
    raise ScenarioError(f"{name}: unknown scenario; {suggestion(name, shipped)} (or specify the path of a YAML file)")


def load_scenario(
    path: Path, *, io_map: IoMap | None = None, machine: Machine | None = None, seed: int | None = None
) -> Scenario:
    """Read a scenario and check it completely.

    Args:
        path: Scenario file.
        io_map: I/O map; None = the default map.
        machine: Machine parameters before the changes made by the scenario; None = the defaults.
        seed: Seed that replaces the one in the file; None = the seed in the file.

    Raises:
        ScenarioError: The file cannot be read, or its content is invalid.
    """
    reader = _ScenarioReader(
        read_section(path, _KEYS, ScenarioError),
        io_map or load_io_map(DEFAULT_IO_MAP),
        machine or load_machine(),
    )
    return reader.scenario(seed)


@dataclass
class _ScenarioReader:
    """Reader of one file for one machine."""

    file: Section
    io_map: IoMap
    machine: Machine

    def scenario(self, seed: int | None) -> Scenario:
        """Return the complete scenario."""
        file, program = self.file, build(self.io_map)
        file_seed = file.read_or("seed", whole(0, 2**31 - 1), 1)
        seed = file_seed if seed is None else seed
        trays = file.read_or("trays", whole(1, 1000), 1)
        machine = self._machine()
        set_points = {"trays_target": trays} | self._set_points(program)
        plant = Plant(self.io_map, machine, seed=seed, trays=trays)
        faults, actions = self._faults(plant), self._actions(CheckContext(program, plant))
        until = self._until()
        for action in actions:
            if action.when.at_ms is not None and action.when.at_ms + action.when.after_ms >= until.limit_ms:
                complaint = (
                    f"{action.text} at {action.when.text} is after the end of the scenario; move it or extend until"
                )
                raise file.error("actions", complaint)
        return Scenario(
            path=file.path,
            title=file.read("title", _text),
            seed=seed,
            trays=trays,
            io_map=self.io_map,
            machine=machine,
            set_points=set_points,
            faults=faults,
            actions=actions,
            until=until,
            checks=read_checks(file, program),
        )

    def _machine(self) -> Machine:
        """Return the machine with the values of the scenario, validated together."""
        section = self.file.section("machine")
        if section is None:
            return self.machine
        values = {name: section.read(name, partial(_parameter, self.machine, name)) for name in section}
        try:
            return self.machine.with_values(values)
        except MachineError as error:
            name, _, complaint = str(error).partition(": ")
            raise section.error(name, complaint) from None

    def _set_points(self, program: Transplanter) -> dict[str, int]:
        section = self.file.section("set_points", program.tags.sp.names())
        if section is None:
            return {}
        words = {name: getattr(program.tags.sp, name) for name in section}
        limits = program.tags.sp.limits
        return {name: section.read(name, partial(_set_point, word, limits[word])) for name, word in words.items()}

    def _faults(self, plant: Plant) -> tuple[Fault, ...]:
        """Return all faults, checked on a temporary plant."""
        schedule, faults = FaultSchedule(plant), []
        for section in self.file.sections("faults", _FAULT_KEYS):
            kind = section.read("kind", _text)
            try:
                fault = Fault(
                    kind,
                    section.read("at", _text),
                    start_ms=section.read_or("from", parse_ms, 0),
                    end_ms=section.read("until", parse_ms) if "until" in section else None,
                    size=section.read("size", partial(parse_size, kind)) if "size" in section else None,
                )
                schedule.add(fault)
            except FaultError as error:
                raise section.error(None, str(error)) from None
            faults.append(fault)
        return tuple(faults)

    def _actions(self, context: CheckContext) -> tuple[Action, ...]:
        if "actions" not in self.file:
            press = VERBS["press"].make("start", 100, context)
            return tuple(
                Action(self._when(at, 0, context.program), f"press: {button}", press) for at, button in _DEFAULT_ACTIONS
            )
        sections = self.file.sections("actions", (*_WHEN_KEYS, "for", *VERBS))
        return tuple(self._action(section, context) for section in sections)

    def _action(self, section: Section, context: CheckContext) -> Action:
        verbs = [verb for verb in VERBS if verb in section]
        if len(verbs) != 1:
            raise section.error(None, f"must contain exactly one action, not {len(verbs)}; {suggestion('', VERBS)}")
        verb = VERBS[verbs[0]]
        if "for" in section and verb.for_ms is None:
            raise section.error("for", f"does not apply to {verbs[0]}; remove it")
        for_ms = section.read_or("for", parse_ms, verb.for_ms or 0)
        what = section.read(verbs[0], _text)
        do = section.read(verbs[0], lambda text: verb.make(text, for_ms, context))
        after_ms = section.read_or("after", parse_ms, 0)
        when = section.read("at", lambda text: self._when(text, after_ms, context.program))
        if when.at_ms is not None and after_ms:
            raise section.error("after", "does not apply to a time; specify the final time in at")
        return Action(when, f"{verbs[0]}: {what}", do)

    def _when(self, text: str, after_ms: int, program: Transplanter) -> When:
        if text[:1].isdecimal():
            return When(text, at_ms=parse_ms(text))
        if text in State.__members__:
            return When(text, state=State[text], after_ms=after_ms)
        steps = [bit.name for sequence in program.program.sequences() for bit, _ in sequence]
        one_of("time, state or step", [*steps, *State.__members__])(text)
        return When(text, step=text, after_ms=after_ms)

    def _until(self) -> Until:
        section = self.file.section("until", ("state", "limit", "time"))
        if section is None:
            raise self.file.error("until", "is missing; add until: {state: COMPLETE, limit: 300 s} or {time: 60 s}")
        if "time" in section:
            if len(list(section)) > 1:
                raise section.error("time", "cannot be combined with state and limit; remove them")
            return Until(section.read("time", _later))
        name = section.read("state", one_of("state", State.__members__))
        return Until(section.read("limit", _later), State[name])


def _later(text: str) -> int:
    at_ms = parse_ms(text)
    if at_ms <= 0:
        raise ValueError(f"must be later than the start, not {text}")
    return at_ms


def _text(text: str) -> str:
    if not text.strip():
        raise ValueError("must not be empty")
    return text


def _parameter(machine: Machine, name: str, text: str) -> Value:
    """Return the value of a parameter, converted to its type in the machine."""
    section_name, _, key = name.partition(".")
    current = getattr(getattr(machine, section_name, None), key, None)
    if current is None:
        try:
            machine.with_values({name: 0})
        except MachineError as error:
            raise ValueError(str(error).removeprefix(f"{name}: ")) from None
    if isinstance(current, bool):
        return one_of("switch", ("true", "false"))(text) == "true"
    value = parse_quantity(text, unit_of(name))
    return int(value) if isinstance(current, int) and value.is_integer() else value


def _set_point(word: Word, limits: tuple[int, int], text: str) -> int:
    """Return the value of a set-point; a time may be given with its unit."""
    unit = re.search(r" x(\d+) ms$", word.name)
    if unit is not None and not text.strip().isdecimal():
        time_ms, unit_ms = parse_ms(text), int(unit[1])
        if time_ms % unit_ms:
            raise ValueError(f"{text!r}: must be a multiple of {unit_ms} ms")
        text = str(time_ms // unit_ms)
    return whole(*limits)(text)
