"""Extensions of the program that lack a declaration are reported in one line, with exit code 2."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from tests.paths import ROOT
from tests.real_time import COMMAND_S
from tests.sampling import first_of

PROGRAM: Final = "controller/program/"
ARM, ALARMS, TAGS, TRAY_TAGS, RULES = (
    f"{PROGRAM}{name}.py" for name in ("arm", "alarms/table", "tags", "tray_tags", "interlocks")
)
COMMANDS, REFUSALS = (f"{PROGRAM}operator/{name}.py" for name in ("commands", "refusals"))
STATES, SET_POINTS, SCHEMA = f"{PROGRAM}states.py", f"{PROGRAM}set_points.py", "controller/iomap/schema.py"
TEXTS: Final = "controller/program/texts/"
_ALARMS: Final = {alarm.bit.number for alarm in build(load_io_map(DEFAULT_IO_MAP).all_wired()).alarms}
FREE_ALARM: Final = next(number for number in range(972, 1000) if number not in _ALARMS)

LIMIT: Final = (ARM, 'limit("approach row", SLIDE', 'limit("clamp tray", SLIDE')
NEW_COMMAND: Final = (
    COMMANDS,
    "        self._add_ways_out()\n\n",
    '        self._add_ways_out()\n        self.clamp = self._add("clamp", "clamp the tray")\n\n',
)

Edit = tuple[str, str, str]
"""File, text to replace, and new text."""

INCOMPLETE: Final[dict[str, tuple[list[Edit], tuple[str, ...]]]] = {
    "step with an alarm without a number": (
        [LIMIT],
        (f"{ARM}:", f"'clamp tray' is missing in ARM_ALARM_NUMBERS ({ALARMS}); add it there"),
    ),
    "step with an alarm without a text": (
        [LIMIT, (ALARMS, '    "overrun": (958', '    "clamp tray": (976, 977),\n    "overrun": (958')],
        (f"{ARM}:", f"'clamp tray' is missing in ALARMS ({TEXTS}alarms/messages.py)"),
    ),
    "alarm without a text": (
        [(ALARMS, 'self.add("cups_slow",', 'self.add("clamp",')],
        (f"{ALARMS}:", f"'clamp' is missing in ALARMS ({TEXTS}alarms/messages.py)"),
    ),
    "output of an arm without a wire": (
        [(COMMANDS, '    "claws_close",\n)', '    "claws_close",\n    "tray_clamp",\n)')],
        (f"{TAGS}:", "io_map.yaml: no wired point left.tray_clamp", SCHEMA),
    ),
    "request of an unknown output": (
        [(ARM, 'hold=[want["slide_inward"]]', 'hold=[want["tray_clamp"]]')],
        (f"{ARM}:", f"'tray_clamp' is missing in ARM_OUTPUTS ({COMMANDS})"),
    ),
    "output without a name": (
        [(SCHEMA, '        "tray_forward",\n', '        "tray_forward",\n        "tray_clamp",\n')],
        (f"{SCHEMA}:", f"'tray_clamp' is missing in POINT_NAMES ({SCHEMA})"),
    ),
    "input that is not in the map": (
        [(TAGS, 'x[f"{side}.lift_down"]', 'x[f"{side}.clamped"]')],
        (f"{TAGS}:", "io_map.yaml: no wired point left.clamped"),
    ),
    "transition to an unknown step": (
        [(ARM, 'To("settle at row", when=a.at_wanted_row)', 'To("clamp", when=a.at_wanted_row)')],
        (f"{ARM}:", "left arm: step 'approach row' goes to unknown step 'clamp'"),
    ),
    "rule for an unknown step": (
        [(RULES, 'cycle["open claws"]', 'cycle["clamp tray"]')],
        (f"{RULES}:", "left arm has no step 'clamp tray'"),
    ),
    "rule for an unknown output": (
        [(RULES, '("slide_inward",),\n            all_of(a.down', '("tray_clamp",),\n            all_of(a.down')],
        (f"{RULES}:", f"'tray_clamp' is missing in ARM_OUTPUTS ({COMMANDS})"),
    ),
    "rule for an unknown output of the tray": (
        [(RULES, 'both = ("tray_run", "tray_forward")', 'both = ("tray_run", "tray_clamp")')],
        (f"{RULES}:", f"'tray_clamp' is missing in tray_requests ({RULES})"),
    ),
    "step without a time limit": (
        [(ARM, '            watch=limit("approach row", SLIDE_LIMIT_MS),\n', "")],
        (f"{ARM}:", "step 'approach row' causes motion without a time limit; add watch or dwell"),
    ),
    "sequence that cannot be stepped": (
        [(ARM, 'machine.step_armed[f"{a.side} arm"]', 'machine.step_armed["clamp"]')],
        (f"{ARM}:", f"'clamp' is missing in STEPPED ({TAGS})"),
    ),
    "stepped sequence that does not exist": (
        [(TAGS, '"right arm", "tray feeder")', '"right arm", "tray feeder", "clamp")')],
        ("STEPPED contains 'clamp', which is no sequence",),
    ),
    "jog without a request": (
        [(COMMANDS, 'for output in ARM_OUTPUTS), "tray_run")', 'for output in ARM_OUTPUTS), "tray_run", "clamp")')],
        ("JOGGED contains 'clamp', which has no request",),
    ),
    "command without a text": ([NEW_COMMAND], (f"'clamp' is missing in ORDERS ({TEXTS}operator.py)",)),
    "command without a row of obstacles": (
        [(REFUSALS, "        yield commands.hold, [running]\n", "")],
        (f"{REFUSALS}:", "command.hold is missing in Orders._table"),
    ),
    "refusal without a text": (
        [(REFUSALS, "    NOT_IDLE =", "    CLAMPED = 99\n    NOT_IDLE =")],
        (f"'CLAMPED' is missing in REFUSALS ({TEXTS}operator.py)",),
    ),
    "mode without a text": (
        [(STATES, "    ZERO_RETURN = 6", "    ZERO_RETURN = 6\n    CLEANING = 7")],
        (f"7 CLEANING is missing in MODES ({TEXTS}operator.py)",),
    ),
    "state without a text": (
        [(STATES, "    COMPLETE = 17", "    COMPLETE = 17\n    CLEANING = 18")],
        (f"18 CLEANING is missing in STATES ({TEXTS}operator.py)",),
    ),
    "set-point with an invalid default": (
        [(SET_POINTS, 'add("trays target", 0, 0, 1000', 'add("trays target", 2000, 0, 1000')],
        (f"{SET_POINTS}:", "set-point 'trays target': default 2000 is not within 0 to 1000"),
    ),
    "area without a free relay": (
        [(TAGS, "100 * index, 199 + 100 * index, side)", "100 * index, 150 + 100 * index, side)")],
        (f"{TAGS}:", "M100 to M150 are all used by left; docs/reference/devices.md lists the free numbers"),
    ),
    "relay that is in use": (
        [(TAGS, '"M", 1056, "batch', '"M", 1024, "batch')],
        ("M1024 batch complete: already used by 'left.loaded'; next free number: M1038",),
    ),
    "timer that is in use": (
        [(TRAY_TAGS, "self.t_jam = Timer(104", "self.t_jam = Timer(103")],
        ("T103 tray.jam: already used by 'tray.no tray'; next free number: T26",),
    ),
    "alarm number that is in use": (
        [(ALARMS, '"cups_slow", number=996', '"cups_slow", number=972')],
        (f"S972 alarm: cups_slow: already used by 'alarm: outputs_taken'; next free number: S{FREE_ALARM}",),
    ),
    "states of two sequences": (
        [(TRAY_TAGS, "self.first_step = 180", "self.first_step = 100")],
        ("already used by 'right arm: ", "next free number: S39"),
    ),
}


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy of the controller and its I/O map."""
    root = tmp_path_factory.mktemp("project")
    shutil.copytree(ROOT / "controller", root / "controller", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "io_map.yaml", root)
    return root


@pytest.mark.parametrize("name", first_of(INCOMPLETE))
def test_a_missing_declaration_is_reported_in_one_line(name: str, project: Path) -> None:
    """The line names the file in which something is missing, and what is missing."""
    edits, expected = INCOMPLETE[name]
    saved = {file: (project / file).read_text(encoding="utf-8") for file, _, _ in edits}
    try:
        for file, before, after in edits:
            assert before in saved[file]
            (project / file).write_text(saved[file].replace(before, after, 1), encoding="utf-8")
        done = subprocess.run(
            [sys.executable, "-B", "-m", "controller", "run", "--check"],
            cwd=project,
            env={**os.environ, "PYTHONPATH": str(project)},
            check=False,
            capture_output=True,
            text=True,
            timeout=COMMAND_S,
        )
    finally:
        for file, text in saved.items():
            (project / file).write_text(text, encoding="utf-8")
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert [part for part in expected if part not in done.stderr] == []
