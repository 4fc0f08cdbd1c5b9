"""Package for an FX2N: program and device comments as GX Works2 CSV files, and the program as instruction list."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import Final

from controller.core.devices import ANNUNCIATORS
from controller.core.program import Program
from controller.export.instruction_list import POWER_UP, SUPERVISION, acting, export
from controller.export.packages.first_minutes import KeptMemory, first_minutes
from controller.export.packages.package import (
    CONFIRMATION,
    README,
    PackageReport,
    PackageSource,
    require_terminals,
    write_files,
)
from controller.export.scan_supervision import LONGEST_MEAN_MS, LONGEST_MS
from controller.fx.language.check import CASSETTE_STEPS, MOST_STEPS, budget, remedy_for_steps, usage
from controller.fx.language.editor_blocks import MOST_LINES, editor_blocks
from controller.fx.language.gx_comments import MOST_CHARACTERS, PLC_CHARACTERS, commented_devices, write_gx_comments
from controller.fx.language.gx_csv import write_gx_csv
from controller.fx.language.il import write_il
from controller.fx.language.instruction import Ladder
from controller.fx.timing.scan_time import scan_time_bounds

CSV: Final = "transplanter.csv"
"""Program for *Read from CSV File* of GX Works2."""
COMMENTS: Final = "transplanter_comments.csv"
"""Device comments, for *Read from CSV File* of the device comment editor."""
IL: Final = "transplanter.il"
"""Program as a plain-text instruction list with titles and comments."""

_LATCHED: Final = KeptMemory(
    later=3,
    note="The memory of an FX2N is lost if it has never been written, and if the PLC reports a low battery (M8005) at "
    "power-up; M2 is on in the first scan then, and the set-points return to their defaults. Replace the battery. The "
    "declaration of a new machine is refused once the memory is valid.",
)

_README: Final = """{name}: program for a MELSEC FX2N

{csv}           program for GX Works2: UTF-16, tab-separated, with step numbers
{comments}  device comments for GX Works2: the same encoding
{il}            the same program as a plain-text instruction list, with titles and full device comments

1. In GX Works2, create a project: series FXCPU, type FX2N/FX2NC, language Ladder.
2. Open the program MAIN. Select Edit > Read from CSV File and choose {csv}.
3. Open Global Device Comment. Select Edit > Read from CSV File and choose {comments}.
4. Convert the program (F4), then write it to the PLC (Online > Write to PLC).

{comment_limits}

Ladder blocks: at most {lines} lines of 12 cells, the most that GX Works2 edits (general knowledge).

Memory: {steps} steps. An FX2N has {most_steps} steps, with a memory cassette {cassette_steps} (general knowledge).

{scan_time}

{alarms}

{minutes}
{confirmation}
The files have not yet been loaded into GX Works2, nor the program into a real FX2N.
"""


def write_package(source: PackageSource, folder: Path) -> PackageReport:
    """Write the package and return its size.

    Raises:
        LadderError: The program cannot be exported.
        PackageError: The folder cannot be written, or the inputs are to be on a field link.
    """
    require_terminals(source, "fx2n")
    program = acting(source.program)
    ladder = export(program, source.pulses)
    files = {CSV: write_gx_csv(ladder), COMMENTS: write_gx_comments(ladder), IL: write_il(ladder).encode()}
    write_files(folder, files | {README: _readme(source, program, ladder).encode()})
    used = usage(ladder)
    fits = used.steps <= MOST_STEPS
    verdict = "fits" if fits else f"does not fit: more than {MOST_STEPS} steps; {remedy_for_steps(used.steps)}"
    return PackageReport((f"FX2N: {used}", *_budget(program, ladder), *_facts(ladder), verdict), fits)


def _readme(source: PackageSource, program: Program, ladder: Ladder) -> str:
    return _README.format(
        name=program.name,
        csv=CSV,
        comments=COMMENTS,
        il=IL,
        comment_limits=fill(
            f'Comments: at most {MOST_CHARACTERS} characters; longer ones are cut and end with "...". An FX2N stores '
            f"{PLC_CHARACTERS} characters of a comment (general knowledge); the project has all of them.",
            120,
        ),
        minutes=first_minutes(source.io_map, _LATCHED, lambda _: "device test of GX Works2"),
        confirmation=CONFIRMATION,
        lines=MOST_LINES,
        steps=usage(ladder).steps,
        most_steps=MOST_STEPS,
        cassette_steps=CASSETTE_STEPS,
        scan_time=fill(
            f"Scan time: the program stops the machine with alarm S902 if the mean scan time in one second exceeds "
            f"{LONGEST_MEAN_MS} ms, or if one scan takes longer than {LONGEST_MS} ms. The {scan_time_bounds(ladder)}. "
            "Read D8010 to D8012 (0.1 ms) in the real PLC before the machine is started.",
            120,
        ),
        alarms=fill(
            "Alarms: the program has only those that influence an output, as annunciators from S900. Not exported: "
            f"{_left_out(source.program, program)}. After a loss of memory, the questions are asked without S904.",
            120,
        ),
    )


def _left_out(complete: Program, program: Program) -> str:
    """Return the annunciators of the complete program that the exported one lacks, with their comments."""
    kept = {device.number for device in program.devices() if device.kind == "S"}
    left = {d.number: d.comment for d in complete.devices() if d.kind == "S" and d.number in ANNUNCIATORS}
    return ", ".join(f"S{number} ({left[number]})" for number in sorted({*left} - kept))


def _facts(ladder: Ladder) -> list[str]:
    """Return the lines about ladder blocks, comments, memory and scan time."""
    blocks = list(editor_blocks(ladder))
    large = sum(not block.fits for block in blocks)
    comments = [len(comment) > MOST_CHARACTERS for _, comment in commented_devices(ladder)]
    return [
        f"ladder blocks: {len(blocks)}, the largest with {max(block.lines for block in blocks)} lines, "
        f"{large} too large for GX Works2 ({MOST_LINES} lines, general knowledge)",
        f"device comments: {len(comments)}, {sum(comments)} of them shortened to {MOST_CHARACTERS} characters",
        f"option: a memory cassette has {CASSETTE_STEPS} steps (general knowledge)",
        f"{scan_time_bounds(ladder)}",
        f"scan supervision: mean of one second at most {LONGEST_MEAN_MS} ms, one scan at most {LONGEST_MS} ms",
    ]


def _budget(program: Program, ladder: Ladder) -> list[str]:
    """Return one line for each block of an exported program with its number of steps, and one for the free steps."""
    used = budget(ladder, (POWER_UP, SUPERVISION, *(block.title for block in program.blocks)))
    return [f"{count:>6} {title}" for title, count in (used | {"free": MOST_STEPS - sum(used.values())}).items()]
