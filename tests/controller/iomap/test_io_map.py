"""I/O map and its loader: the wiring matches the paper, and invalid files are rejected."""

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from controller.common.declarations import DeclarationError
from controller.common.modbus.io_map import IoMap, ModbusTable
from controller.iomap import schema
from controller.iomap.loader import DEFAULT_IO_MAP, IoMapError, load_io_map
from tests.paths import ROOT
from tests.sampling import examples

TEXT = DEFAULT_IO_MAP.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def io_map() -> IoMap:
    return load_io_map(DEFAULT_IO_MAP)


def line_with(part: str) -> int:
    """Return the number of the only line of the delivered file that contains this text."""
    (line,) = (number for number, line in enumerate(TEXT.splitlines(), start=1) if part in line)
    return line


def line_of(tag: str) -> int:
    return line_with(f"{{tag: {tag},")


def edited(line: int, old: str, new: str) -> str:
    """Return the delivered file with one line changed."""
    lines = TEXT.splitlines(keepends=True)
    assert old in lines[line - 1]
    lines[line - 1] = lines[line - 1].replace(old, new, 1)
    return "".join(lines)


def load_error(tmp_path: Path, content: str | bytes) -> str:
    """Return the one-line error message for this content, with the folder of the file removed."""
    path = tmp_path / "io_map.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(IoMapError) as caught:
        load_io_map(path)
    line = str(caught.value)
    assert len(line.splitlines()) == 1
    assert line.startswith(f"{path}:")
    return line.removeprefix(f"{tmp_path}/")


# --- Delivered file -----------------------------------------------------------------------------

# Copied from Table 2 of the paper, not from the file: tag, address, decimal value of the octal number.
PAPER = [
    ("start", "X0", 0),
    ("left.lift_down", "X1", 1),
    ("right.lift_up", "X4", 4),
    ("left.slide_at_pick_2", "X7", 7),
    ("left.slide_at_pick_3", "X10", 8),
    ("right.slide_at_feed", "X11", 9),
    ("tray_front_edge", "X15", 13),
    ("left.claws_converged", "X17", 15),
    ("right.claws_spread", "X20", 16),
    ("right.cup_pulse", "X23", 19),
    ("stop", "X24", 20),
    ("emergency_stop", "X25", 21),
    ("tray_run", "Y0", 0),
    ("left.lift_extend", "Y1", 1),
    ("right.lift_retract", "Y4", 4),
    ("right.slide_inward", "Y7", 7),
    ("right.slide_outward", "Y10", 8),
    ("left.converge", "Y11", 9),
    ("right.spread", "Y14", 12),
    ("right.claws_open", "Y17", 15),
    ("right.claws_close", "Y20", 16),
    ("tray_forward", "Y21", 17),
]


@pytest.mark.parametrize(("tag", "address", "number"), PAPER)
def test_wires_match_the_paper(io_map: IoMap, tag: str, address: str, number: int) -> None:
    point = io_map[tag]
    assert (point.tag, point.address, point.device, point.number) == (tag, address, address[0], number)
    assert point.table is (ModbusTable.DISCRETE_INPUT if point.device == "X" else ModbusTable.COIL)
    assert point.offset == number
    assert (point.optional, point.wired, point.line) == (False, True, line_of(tag))


def test_all_22_inputs_and_18_outputs_are_present_in_order(io_map: IoMap) -> None:
    """The required points are the first 22 X terminals and the first 18 Y terminals, in numerical order."""
    assert [point.number for point in io_map.inputs if not point.optional] == list(range(22))
    assert [point.number for point in io_map.outputs if not point.optional] == list(range(18))
    assert io_map.input_count == 1 + max(point.number for point in io_map.inputs)
    assert io_map.output_count == 1 + max(point.number for point in io_map.outputs)
    assert io_map.path == DEFAULT_IO_MAP


def test_optional_points_are_listed_and_only_the_amber_lamp_is_wired(io_map: IoMap) -> None:
    """The amber lamp shows a question to the operator of a machine without a panel."""
    optional = [*io_map.unwired, *(point for point in (*io_map.inputs, *io_map.outputs) if point.optional)]
    assert {point.tag: point.address for point in optional} == {
        "reset": "X26",
        "air_pressure_ok": "X27",
        "magazine_empty": "X30",
        "ground_pulse": "X31",
        "left.claw_pressure": "X32",
        "right.claw_pressure": "X33",
        "left.seedling_beam": "X34",
        "right.seedling_beam": "X35",
        "left.cup_filled": "X36",
        "right.cup_filled": "X37",
        "guard": "X40",
        "horn": "Y22",
        "lamp_red": "Y23",
        "lamp_amber": "Y24",
        "lamp_green": "Y25",
    }
    assert all(point.optional and not point.wired for point in io_map.unwired)
    assert [point.tag for point in optional if point.wired] == ["lamp_amber"]
    assert io_map.get("lamp_amber") is io_map["lamp_amber"]
    assert "horn" not in io_map
    assert io_map.get("horn") is None


def test_a_tag_without_a_wire_is_reported_with_the_remedy(io_map: IoMap) -> None:
    """A point of the map needs a wire; a tag that the map lacks is declared in the module that the message names."""
    with pytest.raises(
        DeclarationError, match=rf"io_map\.yaml:{line_of('horn')}: no wired point horn; set wired: true$"
    ):
        io_map["horn"]
    with pytest.raises(
        DeclarationError, match=r"io_map\.yaml: no wired point clamp; add it, and declare its tag in"
    ) as e:
        io_map["clamp"]
    assert ROOT / str(e.value).rpartition(" ")[2] == Path(schema.__file__)


def test_points_are_accessible_by_tag(io_map: IoMap) -> None:
    assert "stop" in io_map
    assert io_map.get("stop") is io_map["stop"]


def test_only_stops_and_guard_are_normally_closed_and_assumed_active(io_map: IoMap) -> None:
    points = (*io_map.inputs, *io_map.outputs, *io_map.unwired)
    stops = {"stop", "emergency_stop", "guard"}
    assert {point.tag for point in points if point.inverted} == stops
    assert {point.tag for point in points if point.safe} == stops


def test_safe_images_are_raw_levels(tmp_path: Path) -> None:
    """If the wiring is changed, the safe levels follow the polarity, and terminals without a wire are off."""
    path = tmp_path / "io_map.yaml"
    text = TEXT.replace("X24, polarity: normally_closed", "X24, polarity: normally_open")
    path.write_text(text.replace("Y21, polarity: active_high", "Y31, polarity: active_low"))
    io_map = load_io_map(path)
    assert io_map.safe_inputs() == [number == 0o24 for number in range(io_map.input_count)]
    assert io_map.safe_outputs() == [number == 0o31 for number in range(0o31 + 1)]


def test_delivered_safe_images_are_all_off(io_map: IoMap) -> None:
    """All safe levels are off; for the normally closed stop buttons, an off input means that the button is pressed."""
    assert io_map.safe_inputs() == [False] * io_map.input_count
    assert io_map.safe_outputs() == [False] * io_map.output_count


# --- Changes by the user ------------------------------------------------------------------------


def test_an_address_may_be_changed_and_an_optional_point_may_be_wired(tmp_path: Path) -> None:
    path = tmp_path / "io_map.yaml"
    moved = edited(line_of("start"), "X0, ", "X077,")
    path.write_text(moved.replace("X27, wired: false", "X27, wired: true"))
    io_map = load_io_map(path)
    assert (io_map["start"].address, io_map["start"].number, io_map["start"].offset) == ("X077", 63, 0)
    assert [point.tag for point in io_map.inputs if point.number in {0o27, 0o77}] == ["air_pressure_ok", "start"]
    assert io_map["air_pressure_ok"].optional
    assert io_map.input_count == 64
    assert "air_pressure_ok" not in [point.tag for point in io_map.unwired]


HORN = (
    "{tag: horn, address: Y377, polarity: active_low, safe: inactive, modbus: {table: coil, offset: 65535}, meaning: x}"
)


@pytest.mark.parametrize("rest", ["", "optional: []\n", f"optional:\n- {HORN}\n"])
def test_the_optional_section_may_be_short_or_omitted(tmp_path: Path, rest: str) -> None:
    path = tmp_path / "io_map.yaml"
    path.write_text(TEXT[: TEXT.index("optional:\n")] + rest)
    io_map = load_io_map(path)
    assert len(io_map.unwired) == ("horn" in rest)  # not wired by default
    assert "horn" not in io_map


def test_an_output_register_has_a_number_as_its_safe_value(io_map: IoMap, tmp_path: Path) -> None:
    """A wired register is part of the map with its address, safe value and holding register."""
    (register,) = io_map.unwired_registers
    assert (register.tag, register.address, register.safe, register.wired) == ("planter_speed", "D0", 0, False)
    assert (io_map.registers, io_map.safe_registers(), io_map.register("planter_speed")) == ((), [], None)
    path = tmp_path / "io_map.yaml"
    entry = "address: D0,  wired: false, safe: 0, modbus: {table: holding_register, offset: 0}"
    assert entry in TEXT
    changed = "address: D99, wired: true, safe: 32767, modbus: {table: holding_register, offset: 65535}"
    path.write_text(TEXT.replace(entry, changed))
    (register,) = load_io_map(path).registers
    assert (register.device, register.number, register.safe, register.wired) == ("D", 99, 32_767, True)
    assert (register.table, register.offset) == (ModbusTable.HOLDING_REGISTER, 65_535)
    assert load_io_map(path).safe_registers() == [32_767]
    assert load_io_map(path).register("planter_speed") is not None
    assert load_io_map(path).unwired_registers == ()


# --- Invalid files ------------------------------------------------------------------------------

CORRECT = "correct this line or one before it"
OFFSET_REMEDY = "write a decimal number from 0 to 65535, without quotes"
ADDRESS_REMEDY = "write X and octal digits, for example X10"
FREE = "choose a free one"
MEANING_REMEDY = "write the meaning of the active state in quotes"
MODBUS_REMEDY = "write {table: discrete_input, offset: 1} (inputs) or {table: coil, offset: 1} (outputs)"
SAFE_REMEDY = "write the safe value, a number from 0 to 32767, without quotes"
KEYS = "tag, address, meaning, polarity, safe, modbus"

ENTRY_FAULTS = [
    # entry, text in its line, replacement, message after the tag (@tag: line of that tag)
    ("left.lift_down", "X1,", "X8,", "address: X8 is not octal (digits 0-7); decimal 8 is X10"),
    ("tray_run", "Y0,", "Y19,", "address: Y19 is not octal (digits 0-7); decimal 19 is Y23"),
    ("left.lift_down", "X1,", "X400,", "address: X400 is out of range; write X0 to X377"),
    ("tray_run", "Y0,", "Y0400,", "address: Y0400 is out of range; write Y0 to Y377"),
    ("start", "X0,", "Y30,", f"address: Y30 cannot be an input; {ADDRESS_REMEDY}"),
    ("tray_run", "Y0,", "X31,", "address: X31 cannot be an output; write Y and octal digits, for example Y10"),
    ("horn", "Y22,", "X31,", "address: X31 cannot be an output; write Y and octal digits, for example Y10"),
    ("start", "X0,", "x0,", f"address: 'x0' is not an address; {ADDRESS_REMEDY}"),
    ("start", "X0,", "X,", f"address: 'X' is not an address; {ADDRESS_REMEDY}"),
    (
        "start",
        "X0,",
        "X\N{ARABIC-INDIC DIGIT ONE},",
        f"address: 'X\N{ARABIC-INDIC DIGIT ONE}' is not an address; {ADDRESS_REMEDY}",
    ),
    ("start", "X0,", "0,", "address: cannot be 0; write X or Y and octal digits, for example X10"),
    ("left.lift_up", "X2,", "X1,", "address: X1 is already used by left.lift_down on line @left.lift_down; " + FREE),
    ("left.lift_up", "X2,", "X01,", "address: X01 is already used by left.lift_down on line @left.lift_down; " + FREE),
    ("reset", "X26,", "X25,", "address: X25 is already used by emergency_stop on line @emergency_stop; " + FREE),
    (
        "left.lift_up",
        "offset:  2",
        "offset: 1",
        "modbus.offset: discrete_input 1 is already used by left.lift_down on line @left.lift_down; " + FREE,
    ),
    (
        "horn",
        "offset: 20",
        "offset: 17",
        "modbus.offset: coil 17 is already used by tray_forward on line @tray_forward; " + FREE,
    ),
    ("planter_speed", "D0,", "D100,", "address: 'D100' is not an output register; write D0 to D99"),
    ("planter_speed", "D0,", "Y30,", "address: 'Y30' is not an output register; write D0 to D99"),
    ("planter_speed", "safe: 0", "safe: inactive", f"safe: cannot be 'inactive'; {SAFE_REMEDY}"),
    ("planter_speed", "safe: 0", "safe: -1", f"safe: cannot be -1; {SAFE_REMEDY}"),
    ("planter_speed", "safe: 0", "safe: 32768", f"safe: cannot be 32768; {SAFE_REMEDY}"),
    (
        "planter_speed",
        "holding_register",
        "coil",
        "modbus.table: coil does not contain output registers; write holding_register",
    ),
    ("start", "discrete_input", "coil", "modbus.table: coil does not contain inputs; write discrete_input"),
    ("tray_run", "coil", "discrete_input", "modbus.table: discrete_input does not contain outputs; write coil"),
    ("lamp_red", "coil", "discrete_input", "modbus.table: discrete_input does not contain outputs; write coil"),
    (
        "start",
        "discrete_input",
        "holding",
        "modbus.table: cannot be 'holding'; write discrete_input (inputs), coil (outputs) or holding_register",
    ),
    (
        "start",
        "normally_open",
        "active_high",
        "polarity: active_high is not valid for an input; write normally_open or normally_closed",
    ),
    (
        "tray_run",
        "active_high",
        "normally_closed",
        "polarity: normally_closed is not valid for an output; write active_high or active_low",
    ),
    (
        "start",
        "normally_open",
        "NO",
        "polarity: cannot be 'NO'; "
        "write normally_open or normally_closed (inputs), active_high or active_low (outputs)",
    ),
    ("tray_run", "offset:  0", "offset: -1", f"modbus.offset: cannot be -1; {OFFSET_REMEDY}"),
    ("tray_run", "offset:  0", "offset: 65536", f"modbus.offset: cannot be 65536; {OFFSET_REMEDY}"),
    ("tray_run", "offset:  0", "offset: true", f"modbus.offset: cannot be true; {OFFSET_REMEDY}"),
    ("tray_run", "offset:  0", "offset: off", f"modbus.offset: cannot be 'off'; {OFFSET_REMEDY}"),
    ("tray_run", "offset:  0", 'offset: "0"', f"modbus.offset: cannot be '0'; {OFFSET_REMEDY}"),
    ("tray_run", "offset:  0", "offset: 010", f"modbus.offset: cannot be '010'; {OFFSET_REMEDY}"),
    ("tray_run", "offset:  0", "offset: 1.0", f"modbus.offset: cannot be '1.0'; {OFFSET_REMEDY}"),
    ("tray_run", "offset:  0", f"offset: {'9' * 5000}", f"modbus.offset: cannot be '{'9' * 59}...; {OFFSET_REMEDY}"),
    ("tray_run", ", offset:  0", "", f"modbus.offset: is missing; {OFFSET_REMEDY}"),
    ("tray_run", "offset:  0", "ofset:  0", "modbus.ofset: unknown key; did you mean offset?"),
    ("tray_run", "{table: coil, offset:  0}", "[0]", f"modbus: cannot be a list; {MODBUS_REMEDY}"),
    ("start", "safe: inactive", "safe: off", "safe: cannot be 'off'; write active or inactive"),
    ("start", "safe: inactive", "safe: false", "safe: cannot be false; write active or inactive"),
    ("start", "safe: inactive, ", "", "safe: is missing; write active or inactive"),
    ("start", "safe:", "save:", "save: unknown key; did you mean safe?"),
    ("start", "safe:", "sensor: reed, safe:", f"sensor: unknown key; use one of {KEYS}"),
    ("start", "safe:", "wired: true, safe:", f"wired: unknown key; use one of {KEYS}"),
    ("start", "safe:", "safe: active, safe:", "key 'safe' is already defined on line @start; delete one"),
    ("start", "offset:", "offset: 9, offset:", "modbus: key 'offset' is already defined on line @start; delete one"),
    ("start", "safe:", "[safe]: no, safe:", "a list is not a valid key; write a word"),
    ("start", '"start button pressed"', '""', f"meaning: cannot be ''; {MEANING_REMEDY}"),
    ("start", '"start button pressed"', "{a: {b: c}}", f"meaning: cannot be a mapping; {MEANING_REMEDY}"),
    ("tray_run", "safe: inactive", "safe: active", "safe: active would move the machine in a fault; write inactive"),
    ("horn", "wired: false", "wired: no", "wired: cannot be 'no'; write true or false"),
    ("horn", "wired: false", "wired: 0", "wired: cannot be 0; write true or false"),
    ("horn", "wired: false", "wird: false", "wird: unknown key; did you mean wired?"),
]


@pytest.mark.parametrize(("tag", "old", "new", "message"), ENTRY_FAULTS)
def test_an_invalid_entry_is_rejected_with_line_and_tag(
    tmp_path: Path, tag: str, old: str, new: str, message: str
) -> None:
    line = line_of(tag)
    message = re.sub(r"@([\w.]+)", lambda match: str(line_of(match[1])), message)
    assert load_error(tmp_path, edited(line, old, new)) == f"io_map.yaml:{line}: {tag}: {message}"


TAG_REMEDY = "write the name of a wire, for example left.lift_down"
NO_WIRE = "the program has no such wire, delete the entry"


@pytest.mark.parametrize(
    ("new", "message"),
    [
        ("left.lift_upp", "left.lift_upp: tag: is unknown; did you mean left.lift_up?"),
        ("banana", f"banana: tag: is unknown; {NO_WIRE}"),
        ('"two\\nlines"', f"'two\\nlines': tag: is unknown; {NO_WIRE}"),
        (
            "left.lift_down",
            "left.lift_down: tag: is already defined on line @left.lift_down; delete one of the two entries",
        ),
        ("tray_run", "tray_run: tag: does not belong under inputs; move the entry to outputs"),
        ("horn", "horn: tag: does not belong under inputs; move the entry to optional"),
        ("true", f"inputs entry: tag: cannot be true; {TAG_REMEDY}"),
        ("[left.lift_up]", f"inputs entry: tag: cannot be a list; {TAG_REMEDY}"),
    ],
)
def test_an_invalid_tag_is_rejected(tmp_path: Path, new: str, message: str) -> None:
    line = line_of("left.lift_up")
    message = re.sub(r"@([\w.]+)", lambda match: str(line_of(match[1])), message)
    assert load_error(tmp_path, edited(line, "left.lift_up", new)) == f"io_map.yaml:{line}: {message}"


def test_an_entry_without_a_tag_is_rejected(tmp_path: Path) -> None:
    line = line_of("left.lift_up")
    message = load_error(tmp_path, edited(line, "tag: left.lift_up,", ""))
    assert message == f"io_map.yaml:{line}: inputs entry: tag: is missing; {TAG_REMEDY}"


def test_a_required_point_does_not_belong_under_optional(tmp_path: Path) -> None:
    line = line_of("horn")
    message = load_error(tmp_path, edited(line, "tag: horn", "tag: stop"))
    assert message == f"io_map.yaml:{line}: stop: tag: does not belong under optional; move the entry to inputs"


def test_a_multi_line_entry_is_rejected_with_the_line_of_the_key(tmp_path: Path) -> None:
    line = line_of("start")
    block = """  - address: X0
    tag: start
    meaning: begin
    polarity: normally_open
    safe: inactive
    modbus:
      table: discrete_input
      offset: 0
"""
    lines = TEXT.splitlines(keepends=True)
    lines[line - 1] = block
    for shift, message, old, new in [
        (0, "address: X9 is not octal (digits 0-7); decimal 9 is X11", "X0", "X9"),
        (1, "tag: is unknown; did you mean start?", "start", "statr"),
        (4, "safe: cannot be 'on'; write active or inactive", "inactive", "on"),
        (5, f"modbus.offset: is missing; {OFFSET_REMEDY}", "      offset: 0\n", ""),
        (7, f"modbus.offset: cannot be 'one'; {OFFSET_REMEDY}", "offset: 0", "offset: one"),
        (
            8,
            f"modbus: key 'table' is already defined on line {line + 6}; delete one",
            "offset: 0",
            "offset: 0\n      table: coil",
        ),
    ]:
        lines[line - 1] = block.replace(old, new)
        tag = "statr" if new == "statr" else "start"
        assert load_error(tmp_path, "".join(lines)) == f"io_map.yaml:{line + shift}: {tag}: {message}"


def test_missing_points_are_listed_by_section(tmp_path: Path) -> None:
    deleted = {line_of("right.cup_pulse"), line_of("start"), line_of("tray_run")}
    text = "".join(line for number, line in enumerate(TEXT.splitlines(keepends=True), 1) if number not in deleted)
    message = f"io_map.yaml:{line_with('inputs:')}: inputs: missing start, right.cup_pulse; add an entry for each"
    assert load_error(tmp_path, text) == message


def test_a_missing_section_is_reported_as_its_missing_points(tmp_path: Path) -> None:
    before, _, rest = TEXT.partition("outputs:\n")
    text = before + rest[rest.index("optional:") :]
    assert load_error(tmp_path, text).startswith("io_map.yaml:1: outputs: missing tray_run, left.lift_extend, ")


def test_the_fault_with_the_lowest_line_number_is_reported(tmp_path: Path) -> None:
    """If a file has faults of different kinds, including a missing point, the first faulty line is reported."""
    lines = edited(line_of("emergency_stop"), "X25", "X29").splitlines()
    lines[line_of("horn") - 1] = lines[line_of("horn") - 1].replace("horn", "hron")
    del lines[line_of("right.lift_up") - 1]
    line = line_of("emergency_stop") - 1
    message = "address: X29 is not octal (digits 0-7); decimal 29 is X35"
    assert load_error(tmp_path, "\n".join(lines)) == f"io_map.yaml:{line}: emergency_stop: {message}"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "1: file: is empty; write the required sections"),
        ("# only words\n", "1: file: is empty; write the required sections"),
        ("\n\nstart\n", "3: file: does not begin with a section; write its name and a colon"),
        ("- inputs\n", "1: file: does not begin with a section; write its name and a colon"),
        ("inputs: []\nlamps: []\n", "2: file: unknown section 'lamps'; use one of inputs, outputs, optional"),
        ("input: []\n", "1: file: unknown section 'input'; did you mean inputs?"),
        ("inputs:\n", "1: inputs: is not a list; write one '- {tag: ...}' per line below it"),
        ("inputs: []\noutputs: {a: b}\n", "2: outputs: is not a list; write one '- {tag: ...}' per line below it"),
        ("inputs: []\n\ninputs: []\n", "3: inputs: section is already defined on line 1; merge both sections"),
        ("inputs:\n- start\n", "2: inputs: 'start' is not an entry; write {tag: ..., address: ..., ...}"),
        ("inputs:\n-\n  - start\n", "3: inputs: a list is not an entry; write {tag: ..., address: ..., ...}"),
        ("inputs: &a [*a]\n", "1: inputs: a list is not an entry; write {tag: ..., address: ..., ...}"),
        (
            'inputs:\n- {tag: "start"\n- x\n',
            "3: file: is not YAML (expected ',' or '}', but got '-', "
            f"while parsing a flow mapping from line 2); {CORRECT}",
        ),
        (
            "inputs: []\n---\n",
            "2: file: is not YAML (but found another document, "
            f"expected a single document in the stream from line 1); {CORRECT}",
        ),
        (
            "inputs: []\n\ta: b\n",
            f"2: file: is not YAML (found character '\\t' that cannot start any token); {CORRECT}",
        ),
        ("inputs: *a\n", f"1: file: is not YAML (found undefined alias 'a'); {CORRECT}"),
        ("inputs: []\n# \0\n", "2: file: is not YAML (character U+0000); delete the character"),
        ("[" * 5000, "1: file: is not YAML (brackets are nested too deeply); reduce the nesting"),
        (b"inputs: []\n# caf\xe9\n", "2: file: is not UTF-8 text; save it as UTF-8"),
        (TEXT.encode("utf-16"), "1: file: is UTF-16 text; save it as UTF-8"),
        ("inputs: []\n# 启动按钮\n".encode("gbk"), "2: file: is GBK text; save it as UTF-8"),
    ],
)
def test_a_malformed_file_is_rejected(tmp_path: Path, content: str | bytes, message: str) -> None:
    assert load_error(tmp_path, content) == f"io_map.yaml:{message}"


def test_a_missing_file_and_a_folder_are_rejected(tmp_path: Path) -> None:
    for path, reason in [(tmp_path / "none.yaml", "No such file or directory"), (tmp_path, "Is a directory")]:
        with pytest.raises(IoMapError) as caught:
            load_io_map(path)
        assert str(caught.value) == f"{path}: cannot be read ({reason}); specify a YAML file"


# --- Random damage ------------------------------------------------------------------------------


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    """Draw the delivered file with one to five faults in its lines (missing, repeated, moved) or its characters."""
    lines = TEXT.encode().splitlines(keepends=True)
    for _ in range(draw(st.integers(1, 5))):
        at = draw(st.integers(20, len(lines) - 1))  # below the comment at the top
        fault = draw(st.sampled_from(["lose", "double", "move", "swap", "noise"]))
        line = lines[at]
        column = draw(st.integers(0, len(line) - 1))
        if fault == "lose":
            lines[at] = b""
        elif fault == "double":
            lines[at] = line + line
        elif fault == "move":
            lines.insert(draw(st.integers(0, len(lines))), lines.pop(at))
        elif fault == "swap":
            lines[at] = line[:column] + line[column:][:2][::-1] + line[column + 2 :]
        else:
            noise = draw(
                st.one_of(st.binary(max_size=3), st.sampled_from([b"8", b"{", b"'", b"&a ", b"*a", b"\n", b": "]))
            )
            lines[at] = line[:column] + noise + line[column + 1 :]
        lines = [line for line in lines if line]
    return b"".join(lines)


def loaded(path: Path) -> IoMap | str:
    """Return the map, or its error message."""
    try:
        return load_io_map(path)
    except IoMapError as error:
        return str(error)


@examples(40, nightly=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=damaged())
def test_a_damaged_file_gives_a_one_line_error_or_a_complete_map(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "io_map.yaml"
    path.write_bytes(content)
    io_map = loaded(path)
    if isinstance(io_map, str):
        assert re.fullmatch(re.escape(str(path)) + r":[1-9][0-9]*: .+: .+(; .+|\?)", io_map)
        assert len(io_map.splitlines()) == 1
    else:
        assert len([point for point in io_map.inputs if not point.optional]) == 22
        assert len([point for point in io_map.outputs if not point.optional]) == 18
        for points in (io_map.inputs, io_map.outputs):
            assert len({point.number for point in points}) == len({point.offset for point in points}) == len(points)
