"""Reference tables made from the declarations, so that no document can differ from the program."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from controller.core.expr import Bit, Expr, Word, leaves
from controller.core.sequence import Sequence as StepSequence
from controller.core.sequence import Step
from controller.fx.instruction_set import FORMS, KINDS
from controller.fx.special_devices import PROVIDED
from controller.hmi.tag_list import COLUMNS, tag_csv, tag_rows
from controller.program.alarms import Alarm
from controller.program.interlocks import Rule
from controller.program.machine import Transplanter
from controller.program.proof import specification
from controller.program.refusals import Refusal
from controller.program.texts import MODES, REFUSALS

GENERATED = "Made by `python -m controller docs` from the program; do not edit."


def table(heading: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a Markdown table; bars inside cells are escaped."""
    lines = ["| " + " | ".join(heading) + " |", "|" + "---|" * len(heading)]
    lines += ["| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def io_table(machine: Transplanter) -> str:
    """Return every wire of the I/O map."""
    io_map = machine.io_map
    points = (*io_map.inputs, *io_map.outputs, *io_map.unwired)
    rows = [
        (p.address, p.tag, p.meaning, p.polarity.replace("_", " "), "active" if p.safe else "inactive",
         f"{p.table.replace('_', ' ')} {p.offset}", "" if p.wired else "not wired")
        for p in points
    ]  # fmt: skip
    heading = ("address", "tag", "meaning", "polarity", "safe", "Modbus", "")
    return f"# I/O\n\n{GENERATED}\n\n{table(heading, rows)}"


def step_tables(machine: Transplanter) -> str:
    """Return one table a sequence: what each step does, its limit, and where it goes."""
    parts = [f"# Steps\n\n{GENERATED}\n"]
    for sequence in machine.program.sequences():
        rows = [_step_row(sequence, step) for _, step in sequence]
        heading = ("S", "step", "requests", "time or limit", "alarm", "goes to")
        parts.append(f"## {sequence.name}\n\n{table(heading, rows)}")
    return "\n".join(parts)


def _step_row(sequence: StepSequence, step: Step) -> tuple[str, ...]:
    goes = "<br>".join(f"**{to.step}** when {readable(to.when)}" for to in step.go)
    times = []
    if step.dwell:
        preset = step.dwell.preset
        times.append(f"{preset.name}" if isinstance(preset, Word) else f"{preset} ms")
    if step.watch:
        times.append(f"at most {step.watch.ms} ms")
    if step.waits_for:
        times.append(f"waits for {step.waits_for}")
    holds = ", ".join(bit.name.partition(".")[2].removeprefix("want ") for bit in step.hold)
    alarm = f"{step.watch.alarm} {step.watch.alarm.comment}" if step.watch else ""
    return (str(sequence[step.title]), step.title, holds, "; ".join(times), alarm, goes)


def alarm_table(machine: Transplanter) -> str:
    """Return every annunciator with its texts."""
    rows = [
        (a.bit, a.text.en, a.text.zh, _effect(a), "" if a.cause is None else readable(a.cause),
         f"{a.text.check.en}<br>{a.text.check.zh}")
        for a in machine.alarms
    ]  # fmt: skip
    heading = ("S", "text", "文字", "effect", "no reset while", "what to check")
    return f"# Alarms\n\n{GENERATED}\n\n{table(heading, rows)}"


def _effect(alarm: Alarm) -> str:
    if alarm.safety:
        return "safety, outputs off"
    return "stops work" if alarm.stops_work else "warning"


def command_table(machine: Transplanter) -> str:
    """Return the command table and the set-points."""
    commands = [
        (c.number, c.bit, c.name, "" if c.packml is None else c.packml, c.meaning, _heard(machine, c.bit))
        for c in machine.tags.commands
    ]
    control = machine.tags.machine
    reasons = [(reason.value, *REFUSALS[reason.name]) for reason in Refusal]
    modes = [(number, *text) for number, text in MODES.items()]
    limits = machine.tags.sp.limits
    defaults = [
        (word, word.name, first, "{} to {}".format(*limits[word]), word.comment)
        for word, first in machine.tags.sp.defaults
    ]
    return (
        f"# Commands and set-points\n\n{GENERATED}\n\n## Commands\n\nA press lives one scan. A command that is refused "
        f"changes nothing; {control.refused} then holds its number, {control.refusal} that of the reason, and "
        f"{control.refusals} counts.\n\n"
        f"{table(('number', 'device', 'command', 'PackML', 'what it does', 'refused because'), commands)}\n"
        f"## Reasons\n\n{table(('number', 'reason', '原因'), reasons)}\n## Modes\n\nIn {control.mode}, kept without "
        f"power.\n\n{table(('number', 'mode', '模式'), modes)}\n## Set-points\n\n"
        f"{table(('device', 'set-point', 'first value', 'range', 'meaning'), defaults)}"
    )


def _heard(machine: Transplanter, command: Bit) -> str:
    obstacles = machine.orders.obstacles(command)
    return "; ".join(dict.fromkeys(REFUSALS[each.reason.name].en for each in obstacles))


def state_tables(machine: Transplanter) -> str:
    """Return the PackML table: from, to, when; later rows win."""
    rows = [
        (", ".join(s.name.title() for s in row.sources), row.target.name.title(), row.reason, readable(row.when))
        for row in machine.states
    ]
    return f"# States\n\n{GENERATED}\n\nLater rows win.\n\n{table(('from', 'to', 'reason', 'when'), rows)}"


def interlock_tables(machine: Transplanter) -> str:
    """Return the rules of both arms and the tray."""
    parts = [
        f"# Interlocks\n\n{GENERATED}\n\nAn output is on only while it is requested and every rule about it holds.\n"
    ]
    groups: dict[str, list[Rule]] = {f"{side} arm": rules for side, rules in machine.rules.items()}
    for name, rules in {**groups, "tray": machine.tray_rules}.items():
        rows = [(rule.number, rule.name, rule.reason, ", ".join(rule.outputs), readable(rule.allow)) for rule in rules]
        parts.append(f"## {name}\n\n{table(('', 'rule', 'reason', 'outputs', 'allowed while'), rows)}")
    never = [(each.name, each.reason, readable(each.never)) for each in specification(machine).requirements]
    parts.append(f"## What is proved\n\n`python -m controller prove` shows that none of this is so after any scan.\n\n"
                 f"{table(('requirement', 'reason', 'never'), never)}")  # fmt: skip
    return "\n".join(parts)


def device_table(machine: Transplanter) -> str:
    """Return every named relay, register, timer and counter the program uses."""
    used: dict[str, Bit | Word] = {}
    for device in machine.program.devices():
        if device.name and device.kind not in "XYS":
            used.setdefault(f"{device.kind}{device.number:05}", device)
    rows = [(used[key], used[key].name, used[key].comment) for key in sorted(used)]
    return f"# Devices\n\n{GENERATED}\n\n{table(('device', 'name', 'meaning'), rows)}"


def instruction_table(_: Transplanter) -> str:
    """Return every instruction of an FX2N, whether it runs here, and the special devices that mean something here."""
    rows = []
    for kind in KINDS:
        names = [name for name, form in FORMS.items() if form.kind is kind]
        runs = "yes" if kind.supported else "refused"
        rows.append((", ".join(names), "" if kind.fnc is None else kind.fnc, " / ".join(kind.operands), runs))
    heading = ("instruction", "FNC", "operands", "runs here")
    marks = (
        "FNC numbers and the order of operands are seen in independent sources, all but a few; kinds of operands, step "
        "counts by kind of device, and the details of applied instructions rest on general knowledge and wait to be "
        "checked against a Mitsubishi manual."
    )
    return (
        f"# Instructions\n\n{GENERATED}\n\n{marks}\n\n"
        f"{table(heading, rows)}\n## Special devices\n\n{table(('devices', 'meaning here'), PROVIDED.items())}"
    )


def readable(expr: Expr) -> str:
    """Return a condition with the tags' names in place of the addresses."""
    names = {str(leaf): leaf.name for leaf in leaves(expr) if leaf.name}
    text = re.sub(r"[XYMSTCD]\d+", lambda found: f"[{names.get(found[0], found[0])}]", str(expr))
    return f"`{text}`"


REFERENCE = {
    "io.md": io_table,
    "steps.md": step_tables,
    "alarms.md": alarm_table,
    "commands.md": command_table,
    "states.md": state_tables,
    "interlocks.md": interlock_tables,
    "devices.md": device_table,
    "instructions.md": instruction_table,
}


def write_reference(machine: Transplanter, folder: Path) -> list[Path]:
    """Write every table; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, make in REFERENCE.items():
        path = folder / name
        path.write_text(make(machine), encoding="utf-8")
        paths.append(path)
    return paths


TAGS_HEAD = """# Tags for operator panels

Made by `python -m controller tags` from the program; do not edit. The same as CSV: [hmi-tags.csv](hmi-tags.csv). How to
connect a panel: [hmi.md](hmi.md). What only the plant knows, S % among it, the plant serves itself:
[plant-tags.csv](reference/plant-tags.csv).

Addresses count from 0; many panels count from 1, or write coils as 0xxxx, discrete inputs as 1xxxx, holding registers
as 4xxxx. A coil can be read as a discrete input too, a holding register as an input register. 32 bits: low word first.
Commands are presses: write 1.
"""


def tag_page(machine: Transplanter) -> str:
    """Return the Modbus tags of the controller as a page."""
    return f"{TAGS_HEAD}\n{table(COLUMNS, tag_rows(machine))}"


def write_tags(machine: Transplanter, folder: Path) -> list[Path]:
    """Write the tag list as a page and as CSV; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    texts = {folder / "hmi-tags.md": tag_page(machine), folder / "hmi-tags.csv": tag_csv(machine)}
    for path, text in texts.items():
        path.write_text(text, encoding="utf-8")
    return list(texts)
