"""Power flow in the drawing of a rung: the state of each symbol and each wire in an observed scan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from controller.fx.drawing.ladder import RungPictures
from controller.fx.drawing.wiring import RAIL, Wiring
from controller.fx.language.instruction import Ladder
from controller.fx.language.rung_shapes import CONTACTS, ON_BUS, Rung
from controller.fx.observation.observation import FlowState, ScanObservation, state_of

_ORDER: Final = (FlowState.ON, FlowState.UNKNOWN, FlowState.OFF, FlowState.NOT_EXECUTED)
"""States in the order in which one of several parallel contacts determines the node behind them."""

FLOW_STYLE: Final = (
    ".wire.on>*{stroke:#0a57a8;stroke-width:3}.symbol.on>line,.symbol.on>rect,.symbol.on>path{stroke:#0a57a8;"
    "stroke-width:2.4}.symbol.on>rect:not(.band),.symbol.on>path{fill:#c9dcf2}.not-executed{opacity:.4}"
    ".wire.unknown>*,.symbol.unknown>line,.symbol.unknown>rect,.symbol.unknown>path{stroke-dasharray:3 3}"
)
"""Style sheet of the classes: blue and thick with power, pale if not executed, dashed if unknown."""


@dataclass(frozen=True, slots=True)
class RungFlow:
    """States of one rung, which are also the names of CSS classes.

    Attributes:
        symbols: State of each symbol, by the index of its instruction (`data-at`).
        wires: State of each node, by its number (`data-node`).
    """

    symbols: dict[int, FlowState]
    wires: dict[int, FlowState]


class LadderFlow:
    """Power flow of the rungs of one program."""

    def __init__(self, ladder: Ladder, rungs: list[Rung]) -> None:
        """Prepare the rungs of a program, as `rungs_of` returns them."""
        self._list = ladder.instructions
        self._rungs = rungs
        self._wirings: dict[int, Wiring] = {}

    def of_rung(self, number: int, seen: ScanObservation) -> RungFlow:
        """Return the states of a rung in an observed scan."""
        rung = self._rungs[number]
        if rung.leg is None:
            state = seen.state(rung.first, self._list[rung.first])
            if self._list[rung.first].name in ON_BUS and seen.executed[rung.first] is None:
                state = FlowState.ON
            return RungFlow({rung.first: state}, {RAIL: state})
        if number not in self._wirings:
            self._wirings[number] = Wiring(rung.leg)
        wiring = self._wirings[number]
        nodes = self._nodes(rung.first, wiring, seen)
        symbols = {at: seen.state(at, self._list[at]) for at in (*wiring.before, *wiring.outputs)}
        return RungFlow(symbols, nodes)

    def _nodes(self, first: int, wiring: Wiring, seen: ScanObservation) -> dict[int, FlowState]:
        rail = FlowState.NOT_EXECUTED if seen.executed[first] is False else FlowState.ON
        nodes = {RAIL: rail}
        blocks = self._block_starts(first, max((*wiring.before, *wiring.outputs)))
        for at in sorted(wiring.before):
            before = nodes[wiring.before[at]]
            if self._list[at].name in CONTACTS:
                state = _through(before, seen.state(at, self._list[at]))
            else:  # INV inverts its block, so the power is that into the block, and the record of INV
                start = blocks[at]
                into = rail if start is None else nodes[wiring.before[start]]
                executed = seen.executed[at] is not False
                state = _through(into, state_of(seen.powers[at]) if executed else FlowState.NOT_EXECUTED)
            after = wiring.after[at]
            nodes[after] = min(nodes.get(after, FlowState.NOT_EXECUTED), state, key=_ORDER.index)
        return nodes

    def _block_starts(self, first: int, last: int) -> dict[int, int | None]:
        """Return, for each INV of a rung, the first contact of its block; None = the rung, or a branch of it."""
        starts: dict[int, int | None] = {}
        open_blocks: list[int | None] = []
        for at in range(first, last + 1):
            name = self._list[at].name
            if name in CONTACTS and CONTACTS[name] == "LD":
                open_blocks.append(at)
            elif name in ("ANB", "ORB"):
                open_blocks.pop()
            elif name in ("MPS", "MRD", "MPP"):
                open_blocks = [None]
            elif name == "INV":
                starts[at] = open_blocks[-1] if open_blocks else None
            elif name not in CONTACTS and name != "NOP":
                open_blocks = [None]
        return starts


class FlowPictures:
    """Pictures of rungs with power flow."""

    def __init__(self, pictures: RungPictures, flow: LadderFlow) -> None:
        """Combine the pictures and the power flow of one program."""
        self._pictures = pictures
        self._flow = flow

    def svg(self, number: int, seen: ScanObservation) -> str:
        """Return a rung in an observed scan as the text of an SVG file."""
        flow = self._flow.of_rung(number, seen)
        text = self._pictures.svg(number, FLOW_STYLE)
        for kind, key, states in (("symbol", "data-at", flow.symbols), ("wire", "data-node", flow.wires)):
            for index, state in states.items():
                text = text.replace(f'class="{kind}" {key}="{index}"', f'class="{kind} {state}" {key}="{index}"')
        return text


def _through(before: FlowState, contact: FlowState) -> FlowState:
    """Return the state behind a contact."""
    states = (before, contact)
    for state in (FlowState.NOT_EXECUTED, FlowState.OFF, FlowState.UNKNOWN):
        if state in states:
            return state
    return FlowState.ON
