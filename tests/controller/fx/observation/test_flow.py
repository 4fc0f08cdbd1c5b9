"""Power flow in drawings: the wires of a rung carry the power that the engine has recorded."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

import pytest
from hypothesis import given, settings

from controller.fx.drawing.ladder import RungPictures
from controller.fx.drawing.wiring import Wiring
from controller.fx.language.il import read_il
from controller.fx.language.instruction import Ladder
from controller.fx.language.rung_shapes import rungs_of
from controller.fx.observation.end_values import EndValues
from controller.fx.observation.flow import FlowPictures, LadderFlow
from controller.fx.observation.observation import FlowState, ScanObservation, state_of
from controller.fx.observation.observed_plc import ObservedPlc
from tests.controller.export.fx_equality import EXPORTED
from tests.controller.fx.engine import test_networks as networks
from tests.paths import DOCS
from tests.sampling import examples

ON, OFF, GREY, UNKNOWN = FlowState.ON, FlowState.OFF, FlowState.NOT_EXECUTED, FlowState.UNKNOWN
SVG = "{http://www.w3.org/2000/svg}"


def check_outputs(ladder: Ladder, flow: LadderFlow, seen: ScanObservation) -> int:
    """Check that the wire before each output has its recorded power; return the number of outputs."""
    count = 0
    for number, rung in enumerate(rungs_of(ladder)):
        if rung.leg is None:
            continue
        wires = flow.of_rung(number, seen).wires
        for at, node in Wiring(rung.leg).outputs.items():
            expected = state_of(seen.powers[at]) if seen.executed[at] else GREY
            assert wires[node] == expected, (at, ladder.instructions)
            count += 1
    return count


def check_network(lines: list[networks.Line], story: list[networks.Levels]) -> None:
    ladder = read_il("\n".join(networks.text_of(lines)))
    flow, plc, end = LadderFlow(ladder, rungs_of(ladder)), ObservedPlc(ladder, input_filter_ms=0), EndValues(ladder)
    for n, levels in enumerate(story):
        plc.scan(10 * n, levels)
        check_outputs(ladder, flow, plc.observation)
        check_outputs(ladder, flow, end.observe(plc.memory))


@examples(10, nightly=200)
@given(networks.NETWORKS | networks.CONTROLLED, networks.STORIES)
def test_wires_before_outputs_have_the_recorded_power(lines: list[networks.Line], story: list[networks.Levels]) -> None:
    check_network(lines, story[:4])


@pytest.mark.nightly
@settings(max_examples=1_000)
@given(networks.NETWORKS | networks.CONTROLLED, networks.STORIES)
def test_wires_before_outputs_have_the_recorded_power_in_a_thousand_networks(
    lines: list[networks.Line], story: list[networks.Levels]
) -> None:
    check_network(lines, story)


def wires(text: str, levels: list[bool]) -> tuple[dict[int, FlowState], dict[int, FlowState]]:
    """Return the states before and after each contact of the first rung."""
    ladder = read_il("\n".join([*text.split(" / "), "END"]))
    plc = ObservedPlc(ladder, input_filter_ms=0)
    plc.scan(0, levels)
    (rung, *_) = rungs_of(ladder)
    assert rung.leg is not None
    wiring, flow = Wiring(rung.leg), LadderFlow(ladder, [rung]).of_rung(0, plc.observation)
    return tuple(  # type: ignore[return-value]
        {at: flow.wires[node] for at, node in side.items()} for side in (wiring.before, wiring.after)
    )


def test_power_ends_at_an_open_contact() -> None:
    before, after = wires("LD X0 / AND X1 / ANI X2 / OUT Y0", [True, False, False])
    assert before == {0: ON, 1: ON, 2: OFF}
    assert after == {0: ON, 1: OFF, 2: OFF}


def test_parallel_contacts_share_their_wires() -> None:
    before, after = wires("LD X0 / OR X1 / AND X2 / OUT Y0", [False, True, False])
    assert before == {0: ON, 1: ON, 2: ON}
    assert after == {0: ON, 1: ON, 2: OFF}


def test_a_block_in_series_has_power_only_with_power_before_it() -> None:
    before, after = wires("LD X0 / LD X1 / OR X2 / ANB / OUT Y0", [False, True, False])
    assert before == {0: ON, 1: OFF, 2: OFF}
    assert after == {0: OFF, 1: OFF, 2: OFF}


@pytest.mark.parametrize(("level", "expected"), [(False, OFF), (True, ON)])
def test_inversion_in_a_block_inverts_the_block(level: bool, expected: FlowState) -> None:
    _, after = wires("LD X0 / LD X1 / INV / ANB / OUT Y0", [level, False])
    assert after[2] == expected


def test_every_instruction_of_the_machine_is_in_one_rung_picture() -> None:
    pictures = RungPictures(EXPORTED)
    found: list[int] = []
    for number in range(len(pictures.rungs)):
        root = Xml.fromstring(f"<svg>{pictures.fragment(number)}</svg>")  # noqa: S314 - generated text
        for group in root.iter("g"):
            if group.get("class") == "symbol":
                found.append(int(group.attrib["data-at"]))
            found += map(int, group.get("data-joins", "").split())
    assert sorted(found) == list(range(len(EXPORTED.instructions)))


def picture() -> str:
    """Return the picture of a rung in a scan."""
    ladder = read_il("LD X0\nLDP X1\nORI X2\nANB\nOUT Y0\nMPS\nAND X3\nSET M0\nMPP\nOUT T0 K5\nEND\n")
    ladder.comments["X0"] = "left lift"
    plc = ObservedPlc(ladder, input_filter_ms=0)
    plc.scan(0, [True, False, False, False])
    pictures = RungPictures(ladder, columns=4, texts={"X0": ["left lift", "左升降"]})
    return FlowPictures(pictures, LadderFlow(ladder, pictures.rungs)).svg(0, plc.observation)


def test_the_picture_of_the_documentation_is_current() -> None:
    """If it is not, write the result of `picture` to the file."""
    assert (DOCS / "pictures" / "ladder-power-flow.svg").read_text(encoding="utf-8") == picture()


def test_a_picture_has_a_class_for_each_symbol_and_each_wire() -> None:
    svg = picture()
    root = Xml.fromstring(svg)  # noqa: S314 - generated text
    classes: dict[str, list[tuple[int, str]]] = {"symbol": [], "wire": []}
    for group in root.iter(f"{SVG}g"):
        kind, _, state = group.attrib["class"].partition(" ")
        if kind in classes:
            classes[kind].append((int(group.get("data-at") or group.attrib["data-node"]), state))
    assert dict(classes["symbol"]) == {0: "on", 1: "off", 2: "on", 4: "on", 6: "off", 7: "off", 9: "on"}
    assert set(classes["wire"]) == {(0, "on"), (1, "on"), (2, "on"), (3, "off")}
    assert "左升降" in svg
