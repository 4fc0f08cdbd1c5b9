"""What the documents say is so: tables, links, commands, sample output and code."""

from __future__ import annotations

import re
import runpy
import shlex
import textwrap
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest

from controller.__main__ import _parser as controller_parser
from controller.hmi import reference as controller_reference
from controller.io_map import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.tags import SIDES
from plant_sim.bench.measure import Figures
from plant_sim.cli import _parser as plant_parser
from plant_sim.cli import main as plant_main
from plant_sim.links import reference as plant_reference
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.parameters import load_machine
from plant_sim.plant import Plant

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
REFERENCE = DOCS / "reference"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md"), ROOT / "tests/conformance/README.md"])
TEXT = {".cfg", ".csv", ".json", ".md", ".py", ".svg", ".toml", ".txt", ".yaml", ".yml", ""}
NOT_OURS = {"__pycache__", "build", "dist", "var"}


def read(path: Path) -> str:
    """Return the text of a file."""
    return path.read_text(encoding="utf-8")


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of one language, their common indentation taken off."""
    fenced = re.findall(rf"^ *```{language}\n(.*?)^ *```$", read(page), re.DOTALL | re.MULTILINE)
    return [textwrap.dedent(block) for block in fenced]


def prose(page: Path) -> str:
    """Return a page without its code."""
    return re.sub(r"`[^`]*`", "", re.sub(r"^ *```.*?^ *```$", "", read(page), flags=re.S | re.M))


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", read(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def masked(text: str, number: str) -> list[str]:
    """Return the lines of a text with what differs from run to run made equal."""
    return [re.sub(number, "#", line) for line in text.splitlines()]


# --- tables made from the declarations ----------------------------------------------------------


def test_reference_tables_are_those_of_program_and_plant(tmp_path: Path) -> None:
    made = controller_reference.write_reference(build(load_io_map(DEFAULT_IO_MAP)), tmp_path)
    made += plant_reference.write_reference(tmp_path)
    old = [
        path.name
        for path in made
        if not (REFERENCE / path.name).exists() or path.read_bytes() != (REFERENCE / path.name).read_bytes()
    ]
    assert not old, (
        f"docs/reference: {', '.join(old)} not up to date; run: .venv/bin/python -m controller docs --out "
        "docs/reference && .venv/bin/python -m plant_sim docs --out docs/reference"
    )
    assert {path.name for path in REFERENCE.iterdir()} == {path.name for path in made}


def test_the_tag_list_is_that_of_the_program(tmp_path: Path) -> None:
    for path in controller_reference.write_tags(build(load_io_map(DEFAULT_IO_MAP)), tmp_path):
        same = (DOCS / path.name).exists() and path.read_bytes() == (DOCS / path.name).read_bytes()
        assert same, f"docs/{path.name} is not up to date; run: .venv/bin/python -m controller tags --out docs"


# --- links, names, versions ---------------------------------------------------------------------


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if link.startswith(("https://", "http://")):
            continue
        target, _, anchor = link.partition("#")
        path = (page.parent / target).resolve() if target else page
        assert path.exists(), f"{page.relative_to(ROOT)}: {link} leads nowhere"
        assert path.is_relative_to(ROOT), f"{page.relative_to(ROOT)}: {link} leads out of the repository"
        assert not anchor or anchor in anchors(path), f"{page.relative_to(ROOT)}: {link} has no such heading"


def test_every_page_is_reached_from_the_readme() -> None:
    reached, new = set[Path](), {ROOT / "README.md"}
    while new:
        reached |= new
        links = {(page.parent / link).resolve() for page in new for link in re.findall(r"\]\(([^)\s#]+)", prose(page))}
        new = {path for path in links if path.suffix == ".md" and path.exists()} - reached
    assert reached == set(PAGES)


def test_decisions_are_complete_and_numbered() -> None:
    pages = [page for page in sorted((DOCS / "adr").iterdir()) if page.name != "README.md"]
    for number, page in enumerate(pages, start=1):
        text = read(page)
        assert page.name.startswith(f"{number:04}-")
        assert text.startswith(f"# {number}. ")
        assert re.findall(r"^## (.*)$", text, re.MULTILINE) == ["Context", "Decision", "Consequences"], page.name


def test_changelog_has_the_version() -> None:
    version = tomllib.loads(read(ROOT / "pyproject.toml"))["project"]["version"]
    assert re.search(rf"^## \[{re.escape(version)}\] - ", read(ROOT / "CHANGELOG.md"), re.M)


def own_files() -> Iterator[Path]:
    """Yield every text file of the repository, those of tools left out."""
    for path in ROOT.rglob("*"):
        above = path.relative_to(ROOT).parts[:-1]
        hidden = any((part.startswith(".") and part != ".ci") or part.endswith(".egg-info") for part in above)
        if path.suffix in TEXT and not hidden and not NOT_OURS & set(above) and path.is_file():
            yield path


def test_no_file_names_a_place_on_one_machine() -> None:
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
    tags = build(load_io_map(DEFAULT_IO_MAP)).tags
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
def test_commands_are_understood(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    program, *arguments = shlex.split(command)
    if program == "scripts/test":
        assert all(argument in {"--nightly"} or argument.startswith("tests/") for argument in arguments)
        return
    if program in {"scripts/run", "scripts/bench"}:
        name = program.removeprefix("scripts/")
        assert f"-m plant_sim {name} " in read(ROOT / program)
        parser, arguments = plant_parser(), [name, *arguments]
    else:
        assert program == ".venv/bin/python"
        assert arguments.pop(0) == "-m"
        parser = {"controller": controller_parser, "plant_sim": plant_parser}[arguments.pop(0)]()
    try:
        parser.parse_args(arguments)
    except SystemExit:
        pytest.fail(f"{command}: {capsys.readouterr().err}")


def test_options_of_the_hardware_guide_have_the_first_values_told() -> None:
    options = vars(controller_parser().parse_args(["run"]))
    rows = re.findall(r"^\| `--([\w-]+)` \| `?([^`|]+?)`? \|", read(DOCS / "hil.md"), re.MULTILINE)
    assert rows
    for name, value in rows:
        assert str(options[name.replace("-", "_")]) == value, name


def test_the_trial_of_the_readme_is_the_trial(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The report in the README and the line of progress in the first guide are what `scripts/run --fast` prints."""
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    assert "scripts/run --fast\n" in blocks(ROOT / "README.md", "sh")
    assert plant_main(["run", "--fast"]) == 0
    printed = capsys.readouterr()
    elapsed = r"in \d+\.\d s$"
    (sample,) = blocks(ROOT / "README.md", "text")
    report = iter(masked(printed.out, elapsed))
    for line in masked(sample, elapsed):
        assert line == "..." or line in report, f"README.md: {line!r} is not what scripts/run --fast prints there"
    (line,) = blocks(DOCS / "first-run.md", "text")
    assert line.strip() in printed.err


def test_the_performance_page_has_the_form_of_the_measurement() -> None:
    """Every number that scripts/bench prints is on the page, and none that it does not."""
    number = r" *\d+(?:\.\d+)?"
    (page,) = blocks(DOCS / "performance.md", "text")
    assert masked(page, number) == masked(Figures(*[1.0] * len(fields(Figures))).text(), number)


# --- code ---------------------------------------------------------------------------------------


def test_scenarios_of_the_guide_pass(tmp_path: Path) -> None:
    story = tmp_path / "story.py"
    story.write_text("\n\n".join(blocks(DOCS / "scenario.md", "python")), encoding="utf-8")
    scenarios = [value for name, value in runpy.run_path(str(story)).items() if name.startswith("test_")]
    assert len(scenarios) == len(blocks(DOCS / "scenario.md", "python"))
    for scenario in scenarios:
        scenario()


class WatchedPlant(Plant):
    """A plant that remembers whether its start button was ever down."""

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
