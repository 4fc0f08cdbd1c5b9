"""Copy of the checkout in which damages are planted and tests are run."""

from __future__ import annotations

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from time import perf_counter
from typing import Final

from scripts.foreign_files import FOLDER as FOREIGN_FILES
from tests.machine_code import give_machine_code
from tests.suite.dependencies import tracked

PASSED: Final = 0
NO_TESTS_COLLECTED: Final = 5
"""Exit code of pytest if no tests are collected."""
_IDENTITY: Final = ("-c", "user.name=Tests", "-c", "user.email=tests@localhost", "-c", "commit.gpgsign=false")
_SUMMARY: Final = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", re.MULTILINE)


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run of tests.

    Attributes:
        code: Exit code of pytest; None if it was ended at the time limit.
        output: Its output.
        duration_s: Duration, s.
        cpu_s: Processor time of the process and of the processes that it has waited for, s.
    """

    code: int | None
    output: str
    duration_s: float
    cpu_s: float

    @property
    def passed(self) -> bool:
        """True if all tests passed, or none was collected."""
        return self.code in {PASSED, NO_TESTS_COLLECTED}

    @property
    def detected_by(self) -> str:
        """Failed test; the test file, if it cannot be imported; "the start of the tests", if no file was read."""
        found = _SUMMARY.search(self.output)
        return found[1] if found else "the start of the tests"


class SourceCopy:
    """Copy of the files of a checkout that git does not ignore, and of those made by its build.

    Byte code is stored with a checksum of its source instead of its modification time, because a damaged and a restored
    file of the same size and time would share the latter. Machine code is cached beside the copy, which at first has
    that of the checkout. The copy is a repository of its own, because some tests ask git for the files.
    """

    def __init__(self, folder: Path, checkout: Path) -> None:
        """Copy the files.

        Args:
            folder: Empty or missing folder that takes the copy and its machine code.
            checkout: Root of the checkout, which is not changed.
        """
        self.root = folder / "project"
        self._machine_code = folder / "machine-code"
        for name in tracked(checkout):
            target = self.root / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(checkout / name, target)
            installed = checkout / name.replace("package.json", "node_modules")
            if target.name == "package.json" and installed.is_dir():
                target.with_name("node_modules").symlink_to(installed.resolve())
        if (checkout / FOREIGN_FILES).is_dir():
            shutil.copytree(checkout / FOREIGN_FILES, self.root / FOREIGN_FILES)
        for arguments in (("init", "--quiet"), ("add", "--all"), ("commit", "--quiet", "--message", "Copy")):
            subprocess.run(["git", *_IDENTITY, *arguments], cwd=self.root, check=True, capture_output=True)
        give_machine_code(self.root / "plant_sim", self._machine_code)
        compile_all = ("-m", "compileall", "-q", "--invalidation-mode", "checked-hash")
        packages = ("controller", "plant_sim", "scripts", "tests")
        subprocess.run([sys.executable, *compile_all, *packages], cwd=self.root, check=True, capture_output=True)

    @contextmanager
    def planted(self, file: str, text: str) -> Iterator[None]:
        """Replace the text of a file during the `with` block.

        The restored file has its original modification time, by which machine code is found in the cache.
        """
        path = self.root / file
        original, times = path.read_bytes(), path.stat()
        path.write_text(text, encoding="utf-8")
        try:
            yield
        finally:
            path.write_bytes(original)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))

    def run(self, tests: Iterable[str], limit_s: float, marks: str = "not nightly and not weekly") -> Outcome:
        """Run those test files or tests that have the marks, in the given order until the first failure."""
        variables = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
        variables |= {"PYTHONPATH": str(self.root), "NUMBA_CACHE_DIR": str(self._machine_code)}
        variables.pop("PYTHONDONTWRITEBYTECODE", None)
        options = ("-x", "-m", marks, "-p", "no:cacheprovider", "--tb=short", "--timeout=200")
        code: int | None = None
        before, start_s = _cpu_s(), perf_counter()
        with TemporaryFile() as output:
            process = subprocess.Popen(
                [sys.executable, "-m", "pytest", *options, *tests],
                cwd=self.root,
                env=variables,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            with _killed_at_the_end(process), suppress(subprocess.TimeoutExpired):
                code = process.wait(timeout=limit_s)
            output.seek(0)
            text = output.read().decode(errors="replace")
        return Outcome(code, text, perf_counter() - start_s, _cpu_s() - before)


@contextmanager
def _killed_at_the_end(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """Kill a process and the processes that it has left running."""
    try:
        yield
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
