"""Profile files of PLCs: delivered ones, and what is reported for invalid ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.common.modbus.io_map import ModbusTable
from plant_sim.links.plc.profile import ProfileError, load_profile, profile_names
from tests.controller.common.modbus_rig import IO_MAP

VALID = """\
title: any PLC
protocol: modbus
port: 502
outputs:
  device: Y0
  area: coil
  first: 100
  source: assumed
inputs:
  device: M0
  area: coil
  first: 200
  source: assumed
"""
MC = """\
title: any PLC
protocol: mc_3e
port: 5000
outputs: {device: Y0, source: assumed}
inputs: {device: M0, source: assumed}
"""


@pytest.mark.parametrize("name", profile_names())
def test_a_delivered_profile_fits_a_machine_with_all_optional_inputs(name: str) -> None:
    wired = IO_MAP.all_wired()
    profile = load_profile(name, input_count=wired.input_count, output_count=wired.output_count)
    assert profile.ok_bit is not None
    assert profile.ok_bit >= wired.input_count > IO_MAP.input_count


def load(text: str, folder: Path) -> str:
    path = folder / "my_plc.yaml"
    path.write_text(text, encoding="utf-8")
    load_profile(str(path), input_count=IO_MAP.input_count, output_count=IO_MAP.output_count)
    return str(path)


def test_delivered_profiles_have_a_source_for_every_address() -> None:
    assert len(profile_names()) == 7
    for name in profile_names():
        profile = load_profile(name, input_count=IO_MAP.input_count, output_count=IO_MAP.output_count)
        assert len(profile.outputs.source) > 20
        assert len(profile.inputs.source) > 20


def test_fx3u_addresses_are_those_of_the_manual() -> None:
    """Y0 is coil 3300h and M0 coil 0. Source: FX3U MODBUS Serial Communication manual, default map."""
    profile = load_profile("fx3u", input_count=22, output_count=18)
    assert (profile.outputs.first, profile.inputs.first) == (0x3300, 7_000)
    assert profile.outputs.area is profile.inputs.area is ModbusTable.COIL
    assert profile.input_bits(22) == 48


def test_valid_files(tmp_path: Path) -> None:
    load(VALID, tmp_path)
    load(MC, tmp_path)


FAULTS = {
    "unknown protocol": (VALID, "protocol: modbus", "protocol: modbas", 2, "protocol: unknown protocol 'modbas'"),
    "unknown area": (
        VALID,
        "  area: coil\n  first: 100",
        "  area: coils\n  first: 100",
        6,
        "outputs.area: unknown area",
    ),
    "inputs that cannot be written": (
        VALID,
        "  area: coil\n  first: 200",
        "  area: discrete_input\n  first: 200",
        11,
        "inputs.area: unknown area 'discrete_input'",
    ),
    "address as text": (VALID, "first: 100", "first: Y0", 7, "outputs.first: must be an integer, 0 to 65535"),
    "address out of range": (VALID, "first: 100", "first: 65536", 7, "outputs.first: must be an integer"),
    "block beyond the end": (VALID, "first: 100", "first: 65530", 4, "outputs: 21 addresses from 65530 exceed 65535"),
    "overlap": (
        VALID,
        "first: 200",
        "first: 120",
        9,
        "inputs: overlap the outputs at 100 to 120; choose another first",
    ),
    "no source": (VALID, "  source: assumed\ninputs", "inputs", 5, "outputs.source: is missing; add it"),
    "no inputs": (VALID, VALID[VALID.index("inputs") :], "", 1, "inputs: is missing; add it with the keys"),
    "unknown key": (VALID, "port: 502", "port: 502\nspeed: 3", 4, "speed: unknown key"),
    "ok bit within the inputs": (
        VALID,
        "first: 200",
        f"first: 200\n  ok_bit: {IO_MAP.input_count - 1}",
        13,
        f"inputs.ok_bit: must be an integer, {IO_MAP.input_count}",
    ),
    "function 23 on coils": (VALID, "port: 502", "port: 502\nfunction_23: true", 4, "function_23: transfers holding"),
    "function 23 as text": (
        VALID,
        "port: 502",
        "port: 502\nfunction_23: maybe",
        4,
        "function_23: must be true or false",
    ),
    "function 23 with MC": (MC, "port: 5000", "port: 5000\nfunction_23: true", 4, "function_23: is a Modbus function"),
    "octal 8": (MC, "Y0", "Y8", 4, "outputs.device: device 'Y8'"),
    "timer": (MC, "M0", "TN0", 5, "inputs.device: must be one of X, Y, M, S, D, R"),
    "address with MC": (MC, "device: Y0,", "device: Y0, first: 3,", 4, "outputs.first: unknown key"),
    "list": (MC, MC, "- a\n", 1, "file: does not begin with a section"),
    "empty title": (MC, "any PLC", '""', 1, "title: is empty; write text"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_an_invalid_file_is_reported_with_file_line_key_and_remedy(name: str, tmp_path: Path) -> None:
    valid, old, new, line, complaint = FAULTS[name]
    assert old in valid
    with pytest.raises(ProfileError) as error:
        load(valid.replace(old, new, 1), tmp_path)
    text = str(error.value)
    assert text.startswith(f"{tmp_path / 'my_plc.yaml'}:{line}: {complaint}"), text
    assert "\n" not in text


def test_an_unknown_name_and_a_missing_file() -> None:
    with pytest.raises(ProfileError, match="profile 'fx5': did you mean fx5u"):
        load_profile("fx5", input_count=22, output_count=18)
    with pytest.raises(ProfileError, match=r"no_such\.yaml"):
        load_profile("no_such.yaml", input_count=22, output_count=18)
