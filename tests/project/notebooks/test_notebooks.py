"""Names for notebooks, their page, and the example notebooks, each executed in a fresh process."""

from __future__ import annotations

import inspect
import json
import re
from pathlib import Path

import pytest

from plant_sim import api
from scripts.notebooks import FOLDER, execute, page, read_cells, run
from tests.paths import DOCS, ROOT
from tests.sampling import first_of

NOTEBOOKS = sorted((ROOT / FOLDER).glob("*.py"), key=lambda path: path.stem != "own-ladder")
"""The notebooks, that of the least processor time first."""
PAGE = (DOCS / "notebooks.md").read_text(encoding="utf-8")
CODE = re.compile(r"`[^`]*`|\(\S+\)|FX2N")


@pytest.mark.parametrize("path", first_of(NOTEBOOKS))
def test_a_notebook_runs_in_a_fresh_process(path: Path) -> None:
    notebook = run(path)
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    assert [{**cell, "outputs": []} for cell in notebook["cells"] if cell["cell_type"] == "code"] == [
        {**cell, "execution_count": number, "outputs": []}
        for number, cell in enumerate((each for each in read_cells(path.read_text()) if "outputs" in each), 1)
    ]
    outputs = [output for cell in notebook["cells"] for output in cell.get("outputs", ())]
    printed = [output["text"] for output in outputs if output["output_type"] == "stream"]
    assert len(printed) >= 2
    assert not re.search(r"\bnan\b|Warning|object at 0x", json.dumps(outputs))
    pictures = [output for output in outputs if "image/png" in output.get("data", ())]
    assert len(pictures) == path.read_text().count("plt.subplots(")
    shown = page(notebook, "x.ipynb")
    assert shown.startswith("# ")
    assert shown.count("```python") == len(notebook["cells"]) - sum(
        "execution_count" not in c for c in notebook["cells"]
    )


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_text_of_a_notebook_has_no_figures_and_its_code_no_side_effects(path: Path) -> None:
    cells = read_cells(path.read_text(encoding="utf-8"))
    text = CODE.sub("", "\n".join(cell["source"] for cell in cells if cell["cell_type"] == "markdown"))
    assert re.findall(r"\d+", text) == []
    code = "\n".join(cell["source"] for cell in cells if cell["cell_type"] == "code")
    assert not re.search(r"chdir|environ|global |open\(|savefig|random\.", code)
    assert re.search(r"^SEEDS? = ", code, re.MULTILINE)
    imported = re.findall(r"^from (\S+) import|^import (\S+)", code, re.MULTILINE)
    assert {first or second for first, second in imported} <= {"plant_sim.api", "matplotlib.pyplot"}


def test_the_page_lists_the_names_and_the_notebooks_with_their_time() -> None:
    names = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)
    assert sorted(names) == api.__all__
    listed = dict(re.findall(r"^\| \[[^\]]+\]\(notebooks/(\S+)\.py\) \|.*\| ([\d.]+) s \|$", PAGE, re.MULTILINE))
    assert sorted(listed) == sorted(path.stem for path in NOTEBOOKS)
    assert all(float(seconds) < 20 for seconds in listed.values())


@pytest.mark.parametrize("name", api.__all__)
def test_a_name_has_documentation_with_its_arguments(name: str) -> None:
    each = getattr(api, name)
    text = inspect.getdoc(each) or ""
    assert text
    if inspect.isfunction(each):
        arguments = [*inspect.signature(each).parameters]
        assert all(re.search(rf"^ +{argument}: ", text, re.MULTILINE) for argument in arguments if len(arguments) > 2)


def test_cells_are_executed_one_after_the_other_in_a_namespace_of_their_own() -> None:
    source = "# %%\nn = 20\nn + 1\n\n# %%\nprint(n)\n\n# %% [markdown]\n# Text\n\n# %%\nn = None\nn\n"
    cells = execute(read_cells(source))["cells"]
    outputs = [[each.get("text", each.get("data")) for each in cell["outputs"]] for cell in cells if "outputs" in cell]
    assert outputs == [[{"text/plain": "21"}], ["20\n"], []]


def test_a_notebook_that_fails_is_named_with_its_cell(tmp_path: Path) -> None:
    path = tmp_path / "bad.py"
    path.write_text("# %%\n1\n\n# %%\n1 / 0\n", encoding="utf-8")
    with pytest.raises(RuntimeError, match=r'bad\.py: (.|\n)*File "cell 2"(.|\n)*ZeroDivisionError'):
        run(path)
