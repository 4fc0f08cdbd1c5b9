"""Calls in the source that start threads, tasks or event loops."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[4]
HOUSE: Final = "controller/common/supervision"
STARTS_THREADS: Final = {
    "Thread",
    "threading.Timer",
    "ThreadPoolExecutor",
    "start_new_thread",
    "to_thread",
    "run_in_executor",
}
STARTS_TASKS: Final = {
    "create_task",
    "ensure_future",
    "TaskGroup",
    "gather",
    "run_coroutine_threadsafe",
    "asyncio.run",
    "Runner",
    "run_until_complete",
    "run_forever",
    "start_server",
}
SUPERVISED: Final = {"supervised", "in_thread", "supervised_task", "supervised_item", "run_supervised"}
_NAMES: Final = re.compile("|".join(f"{re.escape(name)}\\b" for name in STARTS_THREADS | STARTS_TASKS | SUPERVISED))


class SourceCall(NamedTuple):
    """Call of one of the functions above.

    Attributes:
        file: Path from the root.
        function: Name of the function.
        first: First argument as source text; empty if there is none.
    """

    file: str
    function: str
    first: str


@cache
def source_calls() -> tuple[SourceCall, ...]:
    """Return the calls in both packages."""
    found = []
    for package in ("controller", "plant_sim"):
        for path in sorted((ROOT / package).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            if _NAMES.search(text):
                found += calls_in(text, path.relative_to(ROOT).as_posix())
    return tuple(found)


def calls_in(text: str, file: str) -> list[SourceCall]:
    """Return the calls in a source text."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call):
            whole = ast.unparse(node.func)
            for name in (whole, whole.rpartition(".")[2]):
                if name in STARTS_THREADS | STARTS_TASKS | SUPERVISED:
                    first = node.args[0] if node.args else None
                    argument = first.value if isinstance(first, ast.Constant) else first and ast.unparse(first)
                    found.append(SourceCall(file, name, str(argument or "")))
                    break
    return found
