"""Documentation site: built with strict checks of links and anchors, searchable, with no files from other servers."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.paths import DOCS, ROOT
from tests.real_time import COMMAND_S

pytestmark = pytest.mark.nightly

ELSEWHERE = re.compile(
    r"<(?:script|img|link rel=\"stylesheet\"|link rel=\"preconnect\")[^>]*(?:src|href)=\"https?://[^\"]*"
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the site, built from docs/."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=COMMAND_S
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_every_page_of_docs_is_built(site: Path) -> None:
    pages = {page.relative_to(DOCS).with_suffix(".html").as_posix() for page in DOCS.rglob("*.md")}
    pages = {re.sub(r"README\.html$", "index.html", page) for page in pages}
    built = {page.relative_to(site).as_posix() for page in site.rglob("*.html")}
    assert pages <= built
    assert {"repository/index.html", "repository/CHANGELOG.html", "repository/CONTRIBUTING.html"} <= built


def test_every_notebook_is_a_page_with_its_outputs_and_a_file(site: Path) -> None:
    for path in (DOCS / "notebooks").glob("*.py"):
        text = (site / f"notebooks/{path.stem}.html").read_text(encoding="utf-8")
        assert f'href="{path.stem}.ipynb"' in text
        assert "seedlings in cups" in text or "complete" in text
        assert json.loads((site / f"notebooks/{path.stem}.ipynb").read_text(encoding="utf-8"))["nbformat"] == 4


def test_the_index_finds_text_of_guides_and_sources(site: Path) -> None:
    entries = json.loads((site / "search/search_index.json").read_text(encoding="utf-8"))["docs"]
    places = {entry["location"].partition("#")[0] for entry in entries if "step ladder" in entry["text"]}
    assert "sources/fx2n.html" in places


def test_nothing_is_loaded_from_other_servers(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert not ELSEWHERE.findall(page.read_text(encoding="utf-8")), page.relative_to(site)


def test_links_that_leave_docs_lead_to_pages_of_the_site(site: Path) -> None:
    page = (site / "adding-a-device.html").read_text(encoding="utf-8")
    assert 'href="repository/CHANGELOG.html"' in page


def test_numbered_lists_are_not_interrupted(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert "<ol start=" not in page.read_text(encoding="utf-8"), page.relative_to(site)
