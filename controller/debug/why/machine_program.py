"""Program of the transplanter: its comments, safeguards and interlocks."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

from controller.core.devices import ANNUNCIATORS, Memory
from controller.core.expr import Bit, Expr, evaluate, leaves
from controller.core.program import Program
from controller.debug.why.chinese_names import chinese_names
from controller.debug.why.program import ExplainedProgram
from controller.export.instruction_list import program_ladder
from controller.fx.language.operand_rules import Key
from controller.fx.observation.cross_reference import CrossReference
from controller.fx.observation.why import Reasons
from controller.program.interlocks import Rule, other_requests, tray_requests
from controller.program.machine import Transplanter
from controller.program.operator.commands import ARM_OUTPUTS
from controller.program.texts.interlocks import RULES
from controller.program.texts.operator import Text

SAFEGUARDS = ("stop", "emergency_stop", "guard")
"""Tags of the inputs that are named as a cause, and never as a contact to bridge."""


class MachineProgram(ExplainedProgram):
    """Program of the transplanter as its controller executes it."""

    def __init__(self, machine: Transplanter) -> None:
        """Take the program of a machine."""
        reference, reasons = _references(machine.program)
        super().__init__(reference, reasons)
        self.machine = machine
        self._alarms = {("S", alarm.bit.number): alarm for alarm in machine.alarms}
        self._rules: dict[Key, list[Rule]] = {}
        self._requests: dict[Key, frozenset[Key]] = {}
        for tag, request, rules in _outputs(machine):
            point = machine.io_map.get(tag)
            if point is not None:
                self._rules["Y", point.number] = rules
                self._requests["Y", point.number] = frozenset((each.kind, each.number) for each in leaves(request))
        self._chinese = chinese_names(machine)
        self._safeguards: set[Key] = set()
        for tag in SAFEGUARDS:
            point = machine.io_map.get(tag)
            if point is not None:
                self._safeguards.add(("X", point.number))
        guard = machine.tags.machine.guard_open
        self._safeguards.add((guard.kind, guard.number))

    def name(self, key: Key) -> Text:
        """Return the name of a device with its tag, or of an alarm with its message in both languages."""
        alarm = self._alarms.get(key)
        if alarm is None:
            return super().name(key)
        message = alarm.text.message
        return Text(f"{alarm.bit} “{message.en}”", f"{alarm.bit}“{message.zh}”")

    def tag(self, key: Key) -> Text:
        """Return the tag or comment of a device; in Chinese its name in the tables of the texts, if it has one."""
        tag = super().tag(key)
        return Text(tag.en, self._chinese.get(key, tag.zh))

    def is_safeguard(self, key: Key, of: Key, /) -> bool:
        """Return whether a device is a safeguard, an alarm, or a condition of a rule of an output."""
        if key in self._safeguards or (key[0] == "S" and key[1] in ANNUNCIATORS and key != of):
            return True
        return of in self._rules and key not in self._requests[of]

    def blocking(self, key: Key, memory: Memory, /) -> Iterator[Text]:
        """Yield each rule that does not allow an output at present, if the output is requested.

        In Chinese a rule is named by its reason.
        """
        if not any(memory.bits(kind)[number] for kind, number in self._requests.get(key, ()) if kind in "MS"):
            return
        tag = next((point.tag for point in self.machine.io_map.outputs if ("Y", point.number) == key), "")
        output = tag.rpartition(".")[2]
        for rule in self._rules[key]:
            if output in rule.outputs and not evaluate(rule.allow, memory):
                reason = RULES[rule.name]
                yield Text(f"“{rule.name}”: {reason.en}", f"“{reason.zh}”")


@lru_cache(maxsize=4)
def _references(program: Program) -> tuple[CrossReference, Reasons]:
    """Return the cross references of a program and the reasons for its outputs; a program never changes."""
    texts = {str(device): [device.comment] for device in program.devices() if isinstance(device, Bit)}
    reference = CrossReference(program_ladder(program), texts)
    return reference, Reasons(reference.ladder)


def _outputs(machine: Transplanter) -> Iterator[tuple[str, Expr, list[Rule]]]:
    """Yield tag, request and rules of each output that the interlocks grant."""
    for side, arm in machine.tags.arms.items():
        for output in ARM_OUTPUTS:
            yield f"{side}.{output}", arm.want[output], machine.rules[side]
    for output, request in tray_requests(machine.tags).items():
        yield output, request, machine.tray_rules
    for output, request in other_requests(machine.tags).items():
        yield output, request, machine.other_rules
