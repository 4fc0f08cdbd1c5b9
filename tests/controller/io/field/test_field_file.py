"""Field files: places of the points, and invalid files."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from controller.cli.main import main
from controller.common.modbus.io_map import ModbusTable
from controller.common.modbus.rtu import SerialLine
from controller.io.field.blocks import blocks_of
from controller.io.field.field_file import FieldFileError, load_field, place_of
from controller.io.field.profiles import profiles
from controller.io.field.schema import ModuleTraits
from tests.controller.io.field.field_rig import INPUT_TAGS, IO_MAP, OUTPUT_TAGS, device, file_of, tcp, wires
from tests.paths import DOCS

ALL = wires(INPUT_TAGS)[:-1] + ", " + wires(OUTPUT_TAGS)[1:]
GOOD = f"""lines:
  - {{name: bus, device: /dev/ttyUSB0, baud: 115200, frame: 8N1}}
devices:
  - name: sensors
    profile: registers
    tcp: {{host: 192.0.2.20}}
    unit: 3
    timeout_ms: 20
    wires: {wires(INPUT_TAGS)}
  - name: valves
    profile: wago-750
    line: bus
    unit: 2
    watchdog_ms: 300
    wires: {wires(OUTPUT_TAGS, 32)}
"""


def loaded(folder: Path, text: str) -> str:
    """Load a field file and return its error."""
    path = folder / "field.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FieldFileError) as error:
        load_field(path, IO_MAP)
    return str(error.value)


def test_a_valid_file(tmp_path: Path) -> None:
    path = tmp_path / "field.yaml"
    path.write_text(GOOD, encoding="utf-8")
    sensors, valves = load_field(path, IO_MAP).devices
    assert (sensors.name, sensors.unit, sensors.timeout_ms, sensors.file_line) == ("sensors", 3, 20, 4)
    assert sensors.inputs == tuple((point.number, n) for n, point in enumerate(IO_MAP.inputs))
    assert valves.line == SerialLine("/dev/ttyUSB0", 115_200, "N", 1)
    (block,) = blocks_of("Y", valves.outputs, valves.traits)
    assert (block.table, block.first, block.count) == (ModbusTable.HOLDING_REGISTER, 2, 2)


@pytest.mark.parametrize(
    ("byte_order", "bit_order", "words"),
    [
        (None, None, [0x0001, 0x0002, 0x0100, 0x8000]),
        ("low_first", "high_first", [0x0080, 0x0040, 0x8000, 0x0100]),
        ("high_first", "low_first", [0x0100, 0x0200, 0x0001, 0x0080]),
        ("high_first", "high_first", [0x8000, 0x4000, 0x0080, 0x0001]),
    ],
)
def test_both_orders_of_bytes_and_bits(byte_order: str | None, bit_order: str | None, words: list[int]) -> None:
    """Points 0, 1, 8 and 15 alone in their register, in every combination."""
    own = ModuleTraits.model_validate({"byte_order": byte_order, "bit_order": bit_order})
    traits = profiles()["registers"].merged(own)
    for offset, word in zip((0, 1, 8, 15), words, strict=True):
        (block,) = blocks_of("Y", [(5, offset)], traits)
        assert block.words([number == 5 for number in range(8)]) == [word]
        image = [False] * 8
        block.store(word.to_bytes(2), image)
        assert image == [number == 5 for number in range(8)]
        block.store((word ^ 0xFFFF).to_bytes(2), image)
        assert not any(image)


def test_a_register_without_a_point_is_not_transferred() -> None:
    traits = profiles()["registers"]
    assert place_of("Y", 33, traits) == (ModbusTable.HOLDING_REGISTER, 2, 1)
    runs = blocks_of("Y", [(0, 0), (1, 17), (2, 48)], traits)
    assert [(block.first, block.count) for block in runs] == [(0, 2), (3, 1)]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("profile: registers", "profile: register", ":5: .*'register' is no profile; did you mean registers?"),
        ("profile: registers", "profil: registers", ":5: .*unknown key; did you mean profile?"),
        ("name: valves", "name: sensors", ":10: .*sensors is already used on line 4; choose another name"),
        ("start: 0,", "strat: 0,", r":9: .*wires.strat: is no wire of .*; did you mean start\?"),
        ("start: 0,", "", ":3: devices: missing start; assign each wire to a device"),
        ("start: 0, ", "start: 0, start: 1, ", ":9: .*key 'start' is already defined on line 9; delete one"),
        (
            "left.lift_down: 1,",
            "left.lift_down: 0,",
            ":9: .*left.lift_down: .*bit 0 is already used on line 9; choose a",
        ),
        ("start: 0,", "start: x,", ":9: .*start: cannot be 'x'"),
        ("start: 0,", "start: -1,", ":9: .*start: cannot be -1"),
        ("tray_run: 32,", "tray_run: 32, start: 7,", ":15: .*start is already used on line 9; delete one"),
        ("start: 0,", "start: 0, horn: 60,", ":9: .*horn: is not wired in .*; write wired: true there or delete this"),
        ("    tcp: {host: 192.0.2.20}\n", "", ":4: .*no tcp, tls or line; write one of tcp, tls, line"),
        ("    line: bus\n", "    line: bus\n    tcp: {host: a}\n", ":10: .*has tcp and line; write one of"),
        ("line: bus", "line: bas", r":12: .*line: 'bas' is no serial line; did you mean bus\?"),
        ("baud: 115200", "baud: fast", ":2: .*baud: cannot be 'fast'; write 1200 to 4000000"),
        ("frame: 8N1", "frame: 7E1", ":2: .*frame: cannot be '7E1'; write 8N1"),
        (
            "devices:\n",
            "  - {name: two, device: /dev/ttyUSB0, baud: 9600}\ndevices:\n",
            ":3: .*/dev/ttyUSB0 is already used on line 2; describe a serial line once, with one baud rate",
        ),
        ("    unit: 2\n", "    unit: 0\n", ":13: .*unit: 0 cannot be used on a serial line; write 1 to 247"),
        ("    unit: 3\n", "    unit: 256\n", ":7: .*unit: cannot be 256; write 0 to 255"),
        ("timeout_ms: 20", "timeout_ms: 0", ":8: .*timeout_ms: cannot be 0; write 1 to 10000"),
        ("    watchdog_ms: 300\n", "", ":10: .*watchdog_ms is missing; write the time of the output watchdog"),
        ("watchdog_ms: 300", "watchdog_ms: 250", ":14: .*watchdog_ms: 250 is no multiple of 100 ms; write a multiple"),
        ("watchdog_ms: 300", "watchdog_ms: 50", ":14: .*watchdog_ms: 50 is no multiple of 100 ms; write a multiple"),
        (
            "watchdog_ms: 300",
            "watchdog_ms: 300\n    outputs: {table: holding_register, read_back: 65535}",
            ":16: .*: 32 is beyond the last register; write a smaller offset",
        ),
        (
            "timeout_ms: 20",
            "watchdog: none\n    watchdog_ms: 200",
            ":9: .*the module has no output watchdog; delete the",
        ),
        ("timeout_ms: 20", "watchdog: off", ":8: .*watchdog: cannot be 'off'; write set, tool or none"),
        (
            "timeout_ms: 20",
            "watchdog: set",
            ":4: .*settings: no setting has watchdog_unit_ms; add it, or write watchdog:",
        ),
        ("timeout_ms: 20", "poll_every: 5", ":9: .*start: must be exchanged in every scan; move it to a device entry"),
        ("timeout_ms: 20", "byte_order: big", ":8: .*byte_order: cannot be 'big'; write low_first or high_first"),
        ("timeout_ms: 20", "trip: {table: coil, offset: 1}", ":4: .*has only one of trip and reset; write both"),
        (
            "timeout_ms: 20",
            "settings: [{offset: 1}]",
            ":8: .*settings.*write one of value and watchdog_unit_ms",
        ),
        ("profile: wago-750", "profile: inputs-only", ":11|:14"),
        ("start: 0,", "tray_run: 0, start: 20,", ":9|:15"),
        (
            "    tcp: {host: 192.0.2.20}\n",
            "    tls: {host: 192.0.2.20, ca: no.pem}\n",
            r":6: .*ca: no.pem is no file; write the path of a PEM file",
        ),
        ("devices:\n", "device:\n", ":3: .*unknown key; did you mean devices?"),
        (GOOD, "", ":1: file: is empty"),
        (GOOD, "devices: []\n", ":1: devices: cannot be an empty list; write a list of devices"),
        (GOOD, "devices: [", "is not YAML"),
    ],
)
def test_an_invalid_file_is_one_line_with_line_key_and_remedy(
    old: str, new: str, expected: str, tmp_path: Path
) -> None:
    assert old in GOOD
    message = loaded(tmp_path, GOOD.replace(old, new, 1))
    assert message.startswith(str(tmp_path / "field.yaml"))
    assert re.search(expected, message), message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("offset", "expected"),
    [
        (4, "input_register 0, bit 4 is already used on line 6; choose a free one"),
        (len(INPUT_TAGS) - 1, "is in a register that is already used on line 6; choose another register"),
    ],
)
def test_two_entries_of_one_module_share_no_register(offset: int, expected: str, tmp_path: Path) -> None:
    """Two entries may describe one module, but not one place of it, nor one packed register."""
    path = file_of(
        tmp_path,
        device("a", "registers", tcp(502), wires(INPUT_TAGS[:-1])),
        device("b", "registers", tcp(502), f"{{{INPUT_TAGS[-1]}: {offset}}}"),
        device("c", "registers", tcp(502), wires(OUTPUT_TAGS)),
    )
    with pytest.raises(FieldFileError, match=re.escape(f"field.yaml:11: devices[2].wires.{INPUT_TAGS[-1]}: ")) as error:
        load_field(path, IO_MAP)
    assert expected in str(error.value)


def test_a_file_without_trip_for_a_box_with_a_safe_mode(tmp_path: Path) -> None:
    path = file_of(tmp_path, device("a", "outputs-safe-mode", tcp(502), wires(OUTPUT_TAGS)))
    with pytest.raises(FieldFileError, match=r":2: .*trip and reset are missing; write the flag of the safe mode"):
        load_field(path, IO_MAP)


def test_inputs_on_a_box_with_outputs_only(tmp_path: Path) -> None:
    more = ("trip: {table: coil, offset: 90}", "reset: [{table: coil, offset: 91, value: 0}]")
    path = file_of(tmp_path, device("a", "outputs-safe-mode", tcp(502), ALL, *more))
    with pytest.raises(FieldFileError, match="device a has no inputs; move the wire to another device"):
        load_field(path, IO_MAP)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--field", "{field}", "--host", "192.0.2.1"), "--host: cannot be combined with --field; write it in "),
        (("--field", "{field}", "--timeout-ms", "20"), "--timeout-ms: cannot be combined with --field"),
        (("--field", "no.yaml"), "no.yaml: cannot be read"),
        (("--field", "{field}", "--link-limit-ms", "50"), ":2: a.timeout_ms: the timeouts plus --scan-ms are 50 ms"),
        (("--field", "{watchdog}"), ":2: a.watchdog_ms: 100 ms is not longer than --link-limit-ms plus the polling"),
        (("--field", "{field}"), ":2: a.watchdog_ms: is missing; write the time of the output watchdog that the tool"),
        (("--field", "{none}"), ":2: a.watchdog: none switches the outputs off when nobody writes; use a module with"),
        (("--field", "{field}", "--watchdog-ms", "300"), "--watchdog-ms: cannot be combined with --field; write it in"),
        (("--watchdog-ms", "110"), "--watchdog-ms 110: must be more than --link-limit-ms plus --scan-ms, 110 ms"),
    ],
)
def test_the_command_refuses_what_does_not_fit_with_exit_code_2(
    options: tuple[str, ...], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, and nothing is started: not even the retentive memory is created."""
    field = file_of(tmp_path, device("a", "coils", tcp(502), ALL, timeout_ms=40))
    watchdog, none = tmp_path / "watchdog", tmp_path / "none"
    watchdog.mkdir()
    none.mkdir()
    texts = {
        "{field}": str(field),
        "{none}": str(file_of(none, device("a", "coils", tcp(502), ALL, "watchdog: none", timeout_ms=9))),
        "{watchdog}": str(file_of(watchdog, device("a", "wago-750", tcp(502), ALL, "watchdog_ms: 100", timeout_ms=9))),
    }
    retain = tmp_path / "retentive.json"
    arguments = ["run", "--retain", str(retain), *(texts.get(option, option) for option in options)]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
    assert not retain.exists()


@pytest.mark.parametrize("command", ["run", "check-io"])
@pytest.mark.parametrize("more", [(), ("watchdog: none",)])
def test_a_device_without_output_watchdog_needs_the_option_that_names_the_risk(
    command: str, more: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file is accepted with the option; a device that drives nothing never needs it."""
    sensors = device("a", "inputs-only", tcp(502), wires(INPUT_TAGS), timeout_ms=9)
    field = file_of(tmp_path, sensors, device("b", "coils", tcp(503), wires(OUTPUT_TAGS), *more, timeout_ms=9))
    arguments = [command, "--field", str(field), *(["--check"] if command == "run" else ["--only", "nothing"])]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"{field}:7: b.watchdog") if command == "run" else "b.watchdog" in error
    assert "accept the risk with --allow-no-output-watchdog (if this process is killed" in error
    main([*arguments, "--allow-no-output-watchdog"])
    assert "watchdog" not in capsys.readouterr().err


def test_every_profile_states_its_output_watchdog() -> None:
    """A watchdog that the controller sets is one of the settings; inputs alone need none."""
    for name, profile in profiles().items():
        assert (profile.watchdog == "set") == profile.has_watchdog_setting, name
        assert (profile.watchdog == "none") == (profile.outputs is None), name


def test_the_example_of_the_documentation(capsys: pytest.CaptureFixture[str]) -> None:
    """The option --check prints the place of every wire."""
    assert main(["run", "--check", "--field", str(DOCS / "examples" / "field.yaml")]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert len(lines) == len(IO_MAP.inputs) + len(IO_MAP.outputs)
    assert ["X25", "emergency_stop", "sensors", "unit", "1", "discrete_input", "21"] in lines
    assert ["Y14", "right.spread", "valves", "unit", "1", "holding_register", "2048", "bit", "13"] in lines
    assert ["Y17", "right.claws_open", "claws", "unit", "5", "coil", "2"] in lines
    assert ["Y24", "lamp_amber", "claws", "unit", "5", "coil", "4"] in lines


def test_the_guide_names_every_profile() -> None:
    guide = (DOCS / "hil.md").read_text(encoding="utf-8")
    assert [name for name in profiles() if f"`{name}`" not in guide] == []
