"""Documentation: generated tables and pictures, links, decisions, commands, sample output and code."""

from __future__ import annotations

import argparse
import re
import runpy
import shlex
import textwrap
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest

from controller.cli import docs as controller_reference
from controller.cli import tags as tag_reference
from controller.cli.main import COMMAND_LINE as CONTROLLER
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.tags import SIDES
from plant_sim.cli import docs as plant_reference
from plant_sim.cli.main import COMMAND_LINE as PLANT
from plant_sim.cli.main import main as plant_main
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from scripts.benchmark.catalogue import PARTS
from scripts.benchmark.command import bench_parser
from scripts.benchmark.results import page as performance
from scripts.benchmark.results.record import read_record
from tests.paths import DOCS, ROOT
from tests.plant_sim.hil import score
from tests.project import architecture_pictures
from tests.wiring import YIELD, wired

REFERENCE = DOCS / "reference"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md"), ROOT / "tests/controller/fx/engine/conformance/README.md"])
TEXT = {".cfg", ".csv", ".json", ".md", ".py", ".svg", ".toml", ".txt", ".yaml", ".yml", ""}
NOT_OURS = {"__pycache__", "build", "dist", "var"}


def read(path: Path) -> str:
    """Return the text of a file."""
    return path.read_text(encoding="utf-8")


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of one language, with their common indentation removed."""
    fenced = re.findall(rf"^ *```{language}\n(.*?)^ *```$", read(page), re.DOTALL | re.MULTILINE)
    return [textwrap.dedent(block) for block in fenced]


def prose(page: Path) -> str:
    """Return the text of a page, excluding code."""
    return re.sub(r"`[^`]*`", "", re.sub(r"^ *```.*?^ *```$", "", read(page), flags=re.S | re.M))


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and the site generate them."""
    text = re.sub(r"^ *```.*?^ *```$", "", read(page), flags=re.S | re.M)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def masked(text: str, number: str) -> list[str]:
    """Return the lines of a text with each match of the pattern `number` replaced by "#"."""
    return [re.sub(number, "#", line) for line in text.splitlines()]


# --- generated tables and pictures --------------------------------------------------------------


BY_OTHERS = {"mutants.md", "mutants.csv", "ladder-sizes.md"}
"""Tables of ``prove --mutants`` and ``ladder sizes``, which take long; tests/plant_sim/stories and
tests/controller/cli/test_ladder_sizes.py compare them with the program."""


def test_reference_tables_are_those_of_program_and_plant(tmp_path: Path) -> None:
    paths = controller_reference.write_reference(build(load_io_map(DEFAULT_IO_MAP)), tmp_path)
    paths += plant_reference.write_reference(tmp_path)
    old = [
        path.name
        for path in paths
        if not (REFERENCE / path.name).exists() or path.read_bytes() != (REFERENCE / path.name).read_bytes()
    ]
    assert not old, (
        f"docs/reference: not up to date: {', '.join(old)}; run: .venv/bin/python -m controller docs --out "
        "docs/reference && .venv/bin/python -m plant_sim docs --out docs/reference"
    )
    assert {path.name for path in REFERENCE.iterdir()} == {path.name for path in paths} | BY_OTHERS


def test_the_tag_list_is_that_of_the_program(tmp_path: Path) -> None:
    for path in tag_reference.write_tags(build(load_io_map(DEFAULT_IO_MAP)), tmp_path):
        same = (DOCS / path.name).exists() and path.read_bytes() == (DOCS / path.name).read_bytes()
        assert same, f"docs/{path.name} is not up to date; run: .venv/bin/python -m controller tags --out docs"


def test_the_architecture_pictures_are_up_to_date(tmp_path: Path) -> None:
    for path in architecture_pictures.write(tmp_path):
        same = (DOCS / path.name).exists() and path.read_bytes() == (DOCS / path.name).read_bytes()
        assert same, f"docs/{path.name} is not up to date; run: {architecture_pictures.COMMAND}"


def test_the_architecture_page_lists_every_package() -> None:
    listed = set(re.findall(r"`(\w+)`", " ".join(re.findall(r"^\| (`.*?) \|", read(DOCS / "architecture.md"), re.M))))
    for side in architecture_pictures.SIDES:
        missing = {name for row in architecture_pictures.layers(side) for name in row} - listed
        assert not missing, f"docs/architecture.md: no row for {side}: {', '.join(sorted(missing))}"


# --- links, names, versions ---------------------------------------------------------------------


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_have_a_target(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if link.startswith(("https://", "http://")):
            continue
        target, _, anchor = link.partition("#")
        path = (page.parent / target).resolve() if target else page
        assert path.exists(), f"{page.relative_to(ROOT)}: {link} has no target"
        assert path.is_relative_to(ROOT), f"{page.relative_to(ROOT)}: {link} is outside the repository"
        assert not anchor or anchor in anchors(path), f"{page.relative_to(ROOT)}: there is no heading for {link}"


EXAMPLES = {"tests/plant_sim/twin/test_my_story.py"}
"""Files that the reader of a guide creates."""
PATH = re.compile(r"`((?:controller|plant_sim|tests|scripts|docs)/[\w./-]+)`")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_named_files_exist(page: Path) -> None:
    text = re.sub(r"^ *```.*?^ *```$", "", read(page), flags=re.S | re.M)
    missing = [name for name in PATH.findall(text) if name not in EXAMPLES and not (ROOT / name).exists()]
    assert not missing, f"{page.relative_to(ROOT)}: no such file: {', '.join(missing)}"


def test_every_page_can_be_reached_from_the_readme() -> None:
    reached, new = set[Path](), {ROOT / "README.md"}
    while new:
        reached |= new
        links = {(page.parent / link).resolve() for page in new for link in re.findall(r"\]\(([^)\s#]+)", prose(page))}
        new = {path for path in links if path.suffix == ".md" and path.exists()} - reached
    assert reached == set(PAGES)


STATUS = re.compile(r"^Status: (Accepted|Proposed|Superseded by \[\d+\]\([\w.-]+\))\. Date: (\d{4}-\d\d-\d\d)\.$", re.M)


def test_decisions_have_the_same_form_and_a_row_in_the_index() -> None:
    pages = [page for page in sorted((DOCS / "adr").iterdir()) if page.name != "README.md"]
    rows = []
    for number, page in enumerate(pages, start=1):
        text = read(page)
        assert page.name.startswith(f"{number:04}-")
        title = re.match(rf"# {number}\. (.*)\n\nStatus: ", text)
        status = STATUS.search(text)
        assert title, f"{page.name}: must begin with '# {number}. <title>', an empty line, 'Status: ... Date: ...'"
        assert status, f"{page.name}: the status line must have the form 'Status: Accepted. Date: 2026-11-21.'"
        assert re.findall(r"^## (.*)$", text, re.MULTILINE) == ["Context", "Decision", "Consequences"], page.name
        rows.append(f"| {number} | [{title[1]}]({page.name}) | {status[1]} | {status[2]} |")
    assert re.findall(r"^\| \d.*$", read(DOCS / "adr/README.md"), re.M) == rows


def test_changelog_has_the_version() -> None:
    version = tomllib.loads(read(ROOT / "pyproject.toml"))["project"]["version"]
    assert re.search(rf"^## \[{re.escape(version)}\] - ", read(ROOT / "CHANGELOG.md"), re.M)


def own_files() -> Iterator[Path]:
    """Yield every text file of the repository, except files written by tools."""
    for path in ROOT.rglob("*"):
        above = path.relative_to(ROOT).parts[:-1]
        hidden = any((part.startswith(".") and part != ".ci") or part.endswith(".egg-info") for part in above)
        if path.suffix in TEXT and path.name != ".git" and not hidden and not NOT_OURS & set(above) and path.is_file():
            yield path


def test_no_file_contains_a_path_of_one_computer() -> None:
    place = re.compile(r"(?<![\w.~])/(?:work|root|tmp|home)/")
    files = list(own_files())
    assert {ROOT / "README.md", ROOT / "scripts/test", ROOT / ".ci/run", Path(__file__)} <= set(files)
    found = [f"{path.relative_to(ROOT)}: {hit[0]}" for path in files for hit in place.finditer(read(path))]
    assert not found


def test_the_picture_names_the_terminals_of_the_map() -> None:
    io_map = load_io_map(DEFAULT_IO_MAP)
    arm = ("slide_at_feed", "slide_at_pick_1", "slide_at_pick_2", "slide_at_pick_3", "cup_pulse")
    tags = ["tray_run", "tray_forward", "tray_front_edge", *(f"{side}.{tag}" for side in SIDES for tag in arm)]
    words = "\n".join(Xml.parse(DOCS / "machine.svg").getroot().itertext())  # noqa: S314 - our own file
    assert sorted(re.findall(r"\b[XY][0-7]+\b", words)) == sorted(io_map[tag].address for tag in tags)


def test_orders_and_set_points_of_the_operating_guide_exist() -> None:
    tags = build(wired(*YIELD)).tags
    named = set(re.findall(r"`([a-z]+(?:_[a-z]+)+)`", read(DOCS / "operating.md")))
    assert named
    assert named <= {command.name for command in tags.commands} | set(tags.sp.names())


# --- commands -----------------------------------------------------------------------------------

COMMANDS = [
    pytest.param(command, id=f"{page.name}: {command}")
    for page in PAGES
    for block in blocks(page, "sh")
    for command in block.splitlines()
]


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_can_be_parsed(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    if command in {architecture_pictures.COMMAND, performance.COMMAND}:
        return
    program, *arguments = shlex.split(command)
    if program == "scripts/test":
        assert all(argument in {"--nightly"} or argument.startswith("tests/") for argument in arguments)
        return
    parser: argparse.ArgumentParser
    if program == "scripts/bench":
        parser = bench_parser()
    elif program == "scripts/run":
        assert "-m plant_sim run " in read(ROOT / program)
        parser, arguments = PLANT.parser(), ["run", *arguments]
    else:
        assert program == ".venv/bin/python"
        assert arguments.pop(0) == "-m"
        parsers = {"controller": CONTROLLER.parser, "plant_sim": PLANT.parser, score.__name__: score.parser}
        parser = parsers[arguments.pop(0)]()
    try:
        parser.parse_args(arguments)
    except SystemExit:
        pytest.fail(f"{command}: {capsys.readouterr().err}")


def test_the_hardware_guide_states_the_default_values_of_the_options() -> None:
    options = vars(CONTROLLER.parser().parse_args(["run"]))
    rows = re.findall(r"^\| `--([\w-]+)` \| `?([^`|]+?)`? \|", read(DOCS / "hil.md"), re.MULTILINE)
    assert rows
    for name, value in rows:
        assert str(options[name.replace("-", "_")]) == value, name


def test_the_sample_report_of_the_readme_is_up_to_date(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The report in the README and the progress line in first-run.md match the output of `scripts/run --fast`."""
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    assert "scripts/run --fast\n" in blocks(ROOT / "README.md", "sh")
    assert plant_main(["run", "--fast"]) == 0
    printed = capsys.readouterr()
    elapsed = r"in \d+\.\d s$"
    (sample,) = blocks(ROOT / "README.md", "text")
    report = iter(masked(printed.out, elapsed))
    for line in masked(sample, elapsed):
        assert line == "..." or line in report, f"README.md: scripts/run --fast does not print {line!r} at this point"
    (line,) = blocks(DOCS / "first-run.md", "text")
    assert line.strip() in printed.err


PERFORMANCE = DOCS / "performance.json"


def test_the_performance_page_is_that_of_the_measurement() -> None:
    assert read(DOCS / "performance.md") == performance.performance_page(PERFORMANCE), (
        f"docs/performance.md is not up to date; run: {performance.COMMAND}"
    )


def test_the_measurement_has_every_figure_of_the_parts() -> None:
    """A part that was renamed or has other figures must be measured again."""
    measured = {name: set(part.figures) for name, part in read_record(PERFORMANCE).parts.items() if not part.failed}
    by_name = {part.name: set(part.figures) for part in PARTS}
    assert measured
    assert measured == {name: by_name.get(name) for name in measured}


TEST_RUN = re.compile(r"`scripts/test`|\ball tests\b")
"""Mention of a complete run of the tests, without the nightly ones."""
DURATION = re.compile(r"\b(\d[\d.]*(?: to [\d.]+)? (?:s|min|minutes|seconds|h|hours))\b")


def stated_durations(text: str) -> list[str]:
    """Return the durations that a text states for a run of the tests."""
    sentences = re.split(r"(?<=[.:]) |\n\n", re.sub(r"\n(?!\n)", " ", text))
    return [found for each in sentences if TEST_RUN.search(each) for found in DURATION.findall(each)]


def test_the_pages_state_one_duration_of_the_tests() -> None:
    duration_s = read_record(PERFORMANCE).test_duration_s
    assert duration_s is not None
    stated = {page.relative_to(ROOT).as_posix(): stated_durations(read(page)) for page in PAGES}
    found = {name: durations for name, durations in stated.items() if durations}
    expected = [f"{performance.minutes(duration_s)} minutes"]
    assert found == dict.fromkeys(("CONTRIBUTING.md", "README.md", "docs/performance.md"), expected)


# --- code ---------------------------------------------------------------------------------------


def test_scenarios_of_the_guide_pass(tmp_path: Path) -> None:
    story = tmp_path / "story.py"
    story.write_text("\n\n".join(blocks(DOCS / "scenario.md", "python")), encoding="utf-8")
    scenarios = [value for name, value in runpy.run_path(str(story)).items() if name.startswith("test_")]
    assert len(scenarios) == len(blocks(DOCS / "scenario.md", "python"))
    for scenario in scenarios:
        scenario()


class WatchedPlant(Plant):
    """Plant that records whether its start button was ever pressed."""

    start_seen = False

    def step(self, for_ms: int, y: Sequence[bool]) -> None:
        self.start_seen |= self.box.start
        super().step(for_ms, y)


def test_the_button_of_the_first_guide_is_pressed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    io_map = load_io_map(DEFAULT_IO_MAP)
    plant = WatchedPlant(io_map, load_machine(), seed=1)
    code = tmp_path / "code.py"
    (block,) = blocks(DOCS / "first-run.md", "python")
    with ServerThread(PlantServer(IoModule(plant, io_map), port=0)) as thread:
        code.write_text(block.replace("5020", str(thread.server.port)), encoding="utf-8")
        runpy.run_path(str(code))
    assert float(capsys.readouterr().out) == 2.0  # at feed, against the bumper
    assert plant.start_seen
    assert not plant.box.start
