"""Example notebooks: Python files of cells, executed in a fresh process, as .ipynb files and as pages of the site.

``python -m scripts.notebooks FILE`` executes a notebook and prints it, with its outputs, as an .ipynb file. As a hook
of MkDocs, this module does so for each file in docs/notebooks, and adds the .ipynb file and a page to the site.

A cell begins with a line ``# %%``, or ``# %% [markdown]`` if it is text in comments, the format of Spyder, VS Code and
Jupytext.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files

ROOT: Final = Path(__file__).resolve().parents[1]
FOLDER: Final = "docs/notebooks"
LIMIT_S: Final = 600
"""Longest time of a notebook, s: the end of a hang."""
MARK: Final = re.compile(r"^# %%(?P<text> \[markdown\])?\n", re.MULTILINE)

Cell = dict[str, Any]
"""Cell or output of the notebook format 4.5."""


def read_cells(source: str) -> list[Cell]:
    r"""Return the cells of a notebook without outputs.

    >>> [cell["source"] for cell in read_cells("# %% [markdown]\n# # Title\n\n# %%\n1 + 1\n")]
    ['# Title', '1 + 1']
    """
    _, *parts = MARK.split(source)
    cells = []
    for number, (text, body) in enumerate(zip(parts[::2], parts[1::2], strict=True)):
        cell: Cell = {"id": f"cell-{number}", "metadata": {}}
        if text:
            lines = (line.removeprefix("#").removeprefix(" ") for line in body.strip().splitlines())
            cells.append(cell | {"cell_type": "markdown", "source": "\n".join(lines)})
        else:
            rest: Cell = {"cell_type": "code", "source": body.strip(), "execution_count": None, "outputs": []}
            cells.append(cell | rest)
    return cells


def execute(cells: list[Cell]) -> Cell:
    """Execute the cells one after the other in a new namespace; return the notebook with their outputs.

    An output is the text that a cell prints, the value of its last expression, and the figures that it has made.
    """
    namespace: dict[str, Any] = {"__name__": "__main__"}
    code = (cell for cell in cells if cell["cell_type"] == "code")
    for number, cell in enumerate(code, 1):
        cell["execution_count"] = number
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            value = _value(cell["source"], f"cell {number}", namespace)
        if printed.getvalue():
            cell["outputs"].append({"output_type": "stream", "name": "stdout", "text": printed.getvalue()})
        if value is not None:
            result = {"output_type": "execute_result", "execution_count": number, "metadata": {}}
            cell["outputs"].append(result | {"data": _data(value)})
        pictures = ({"image/png": picture, "text/plain": "Figure"} for picture in _figures())
        cell["outputs"] += [{"output_type": "display_data", "metadata": {}, "data": data} for data in pictures]
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}


def _value(source: str, name: str, namespace: dict[str, Any]) -> Any:
    """Execute a cell; return the value of its last statement if that is an expression."""
    tree = ast.parse(source, name)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, name, "exec"), namespace)  # noqa: S102 - our own notebooks
    if not isinstance(last, ast.Expr):
        return None
    return eval(compile(ast.Expression(last.value), name, "eval"), namespace)  # noqa: S307


def _data(value: Any) -> dict[str, str]:
    """Return a value as text, and as HTML if it is a table."""
    to_html = getattr(value, "_repr_html_", None)
    return {"text/plain": repr(value), **({} if to_html is None else {"text/html": to_html()})}


def _figures() -> Iterator[str]:
    """Yield the open figures of matplotlib as PNG in Base64, and close them."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is None:
        return
    for number in pyplot.get_fignums():
        file = io.BytesIO()
        pyplot.figure(number).savefig(file, format="png", metadata={"Software": None})
        pyplot.close(number)
        yield base64.b64encode(file.getvalue()).decode()


def run(path: Path) -> Cell:
    """Execute a notebook in a fresh process; return it with its outputs.

    Raises:
        RuntimeError: A cell failed; the message is its traceback.
    """
    done = subprocess.run(  # noqa: S603 - our own notebooks
        [sys.executable, "-m", "scripts.notebooks", str(path)],
        cwd=ROOT,
        env=os.environ | {"MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{path.name}: {done.stderr}")
    notebook: Cell = json.loads(done.stdout)
    return notebook


def page(notebook: Cell, name: str) -> str:
    """Return an executed notebook as a page.

    Args:
        notebook: The notebook.
        name: Name of its .ipynb file.
    """
    parts = []
    for cell in notebook["cells"]:
        parts.append(cell["source"] if cell["cell_type"] == "markdown" else f"```python\n{cell['source']}\n```")
        parts += [_shown(output) for output in cell.get("outputs", ())]
    title, _, rest = "\n\n".join(parts).partition("\n")
    return f"{title}\n\n[Download as a notebook]({name})\n{rest}\n"


def _shown(output: Cell) -> str:
    """Return an output as part of a page."""
    data = output.get("data", {"text/plain": output.get("text", "")})
    if "image/png" in data:
        return f'<img alt="figure" src="data:image/png;base64,{data["image/png"]}">'
    if "text/html" in data:
        return re.sub(r"<style.*?</style>", "", data["text/html"], flags=re.DOTALL).replace("\n", "")
    return f"```text\n{data['text/plain'].rstrip()}\n```"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Execute all notebooks; add a page and an .ipynb file of each to the site."""
    from mkdocs.structure.files import File  # noqa: PLC0415 - a notebook is executed without MkDocs

    for path in sorted((ROOT / FOLDER).glob("*.py")):
        notebook, name = run(path), f"{path.stem}.ipynb"
        contents = {f"{path.stem}.md": page(notebook, name), name: json.dumps(notebook, indent=1)}
        for file, content in contents.items():
            files.append(File.generated(config, f"notebooks/{file}", content=content))
    return files


def main(path: Path) -> None:
    """Execute a notebook in this process and print it."""
    notebook = execute(read_cells(path.read_text(encoding="utf-8")))
    sys.stdout.write(json.dumps(notebook))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
