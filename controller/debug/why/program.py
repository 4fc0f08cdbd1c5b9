"""Program of a recorded machine, as far as questions need it: its ladder, reasons and names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from controller.core.devices import Memory, device_name
from controller.fx.language.operand_rules import Key
from controller.fx.observation.cross_reference import CrossReference
from controller.fx.observation.why import Reasons
from controller.program.texts.operator import Text

if TYPE_CHECKING:
    from controller.debug.timeline import RunTimeline
    from controller.debug.why.answer import WhyCause


class ExplainedProgram:
    """Program without knowledge of a machine.

    Attributes:
        reference: Cross references of the ladder.
        reasons: Reasons for its outputs.
    """

    def __init__(self, reference: CrossReference, reasons: Reasons) -> None:
        """Take a program.

        Args:
            reference: Cross references of its ladder.
            reasons: Reasons for its outputs.
        """
        self.reference, self.reasons = reference, reasons

    def name(self, key: Key) -> Text:
        """Return the name of a device with its tag or comment."""
        name, tag = device_name(*key), self.tag(key)
        return Text(f"{name} {tag.en}".rstrip(), f"{name} {tag.zh}".rstrip())

    def tag(self, key: Key) -> Text:
        """Return the tag or comment of a device; empty = none."""
        tag = next(iter(self.reference.device(key).texts), "")
        return Text(tag, tag)

    def is_safeguard(self, _key: Key, _of: Key, /) -> bool:
        """Return whether a device is a safeguard or an interlock of another one: named as cause, never changed."""
        return False

    def blocking(self, _key: Key, _memory: Memory, /) -> Iterable[Text]:
        """Return each rule that does not allow an output with the present devices: its name and its reason."""
        return ()

    def input_causes(self, _key: Key, _line: RunTimeline, _scan: int, _changed: int | None, /) -> Sequence[WhyCause]:
        """Return the physical causes of the level of an input; empty without a plant.

        Args:
            _key: The input.
            _line: Recorded run, at this scan.
            _scan: Scan to which the question refers.
            _changed: Scan in which the input has changed last; None = it has not.
        """
        return ()

    def driver(self, _key: Key, /) -> Key | None:
        """Return the output that moves a part to the switch of an input; None = none is known."""
        return None

    def suspects(self, _line: RunTimeline, /) -> Sequence[WhyCause]:
        """Return the faults that are active in the present state of the machine; empty without a plant."""
        return ()
