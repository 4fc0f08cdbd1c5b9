"""Package for an FX2N: the program as GX Works2 CSV and as instruction list."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from controller.core.program import Program
from controller.export.instruction_list import POWER_UP, acting, export
from controller.export.packages.package import README, PackageReport, PackageSource, require_terminals, write_files
from controller.fx.language.check import MOST_STEPS, budget, usage
from controller.fx.language.gx_csv import write_gx_csv
from controller.fx.language.il import write_il
from controller.fx.language.instruction import Ladder

CSV: Final = "transplanter.csv"
"""Program for *Read from CSV File* of GX Works2."""
IL: Final = "transplanter.il"
"""Program as a plain-text instruction list with titles and comments."""

_README: Final = """{name}: program for a MELSEC FX2N

{csv}  program for GX Works2: UTF-16, tab-separated, with step numbers
{il}   the same program as a plain-text instruction list, with titles and device comments

1. In GX Works2, create a project: series FXCPU, type FX2N/FX2NC, language Ladder.
2. Open the program MAIN. Select Edit > Read from CSV File and choose {csv}.
3. Convert the program (F4), then write it to the PLC (Online > Write to PLC).

The file has not yet been loaded into GX Works2, nor the program into a real FX2N.
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
    readme = _README.format(name=program.name, csv=CSV, il=IL)
    write_files(folder, {CSV: write_gx_csv(ladder), IL: write_il(ladder).encode(), README: readme.encode()})
    used = usage(ladder)
    fits = used.steps <= MOST_STEPS
    verdict = "fits" if fits else f"does not fit: more than {MOST_STEPS} steps"
    return PackageReport((f"FX2N: {used}", *_budget(program, ladder), verdict), fits)


def _budget(program: Program, ladder: Ladder) -> list[str]:
    """Return one line for each block of an exported program with its number of steps, and one for the free steps."""
    used = budget(ladder, (POWER_UP, *(block.title for block in program.blocks)))
    return [f"{count:>6} {title}" for title, count in (used | {"free": MOST_STEPS - sum(used.values())}).items()]
