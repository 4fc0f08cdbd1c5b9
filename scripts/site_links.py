"""MkDocs hook: files outside docs/ that pages link to, and list items as Python-Markdown expects them.

README.md, CHANGELOG.md, CONTRIBUTING.md and every other file a page links to become part of the site, below
`repository/`. Links to folders of the repository become plain text. The contents of list items are indented by four
columns; the pages use two or three, as GitHub allows.
"""

from __future__ import annotations

import re
from pathlib import Path
from posixpath import normpath, relpath
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
START = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")
BELOW = "repository/"

LINK = re.compile(r"(?P<text>!?\[(?:[^\[\]]|\[[^\]]*\])*\])\((?P<target>[^)\s]+)\)")
ITEM = re.compile(r"(?:[-*]|\d+\.) +")
CODE = re.compile(r"(^ *```.*?^ *```$|`[^`\n]*`)", re.DOTALL | re.MULTILINE)


def place(path: str) -> str:
    """Return the path of a repository file in the site."""
    return path.removeprefix("docs/") if path.startswith("docs/") else BELOW + path


def targets(path: str) -> list[str]:
    """Return the files of the repository that a page links to, except within code."""
    text = "".join(CODE.split((ROOT / path).read_text(encoding="utf-8"))[::2])
    links = [match["target"].partition("#")[0] for match in LINK.finditer(text)]
    local = [link for link in links if link and "://" not in link]
    return [normpath(f"{Path(path).parent.as_posix()}/{link}") for link in local]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add every linked file outside docs/ to the site."""
    pages = ["docs/" + file.src_uri for file in files.documentation_pages()]
    pending, seen = [*START, *(target for page in pages for target in targets(page))], set[str]()
    while pending:
        path = pending.pop()
        if path in seen or path.startswith("docs/") or not (ROOT / path).is_file():
            continue
        seen.add(path)
        files.append(File.generated(config, place(path), abs_src_path=str(ROOT / path)))
        if path.endswith(".md"):
            pending += targets(path)
    return files


def indented(markdown: str) -> str:
    """Return a page whose list items have their contents indented by four columns."""
    lines, width, fenced = [], 0, False
    for line in markdown.split("\n"):
        item = None if fenced else ITEM.match(line)
        if line.startswith("```"):
            fenced, width = not fenced, 0
        elif item:
            width = len(item[0])
        elif line.strip() and not line.startswith(" " * max(width, 1)):
            width = 0
        extra = 4 - width if 0 < width < 4 and not item and line.strip() else 0
        lines.append(" " * extra + line)
    return "\n".join(lines)


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Rewrite links that cross the boundary of docs/."""
    uri = page.file.src_uri
    origin = uri.removeprefix(BELOW) if uri.startswith(BELOW) else f"docs/{uri}"

    def rewrite(match: re.Match[str]) -> str:
        link, _, anchor = match["target"].partition("#")
        if not link or "://" in link:
            return match[0]
        path = normpath(f"{Path(origin).parent.as_posix()}/{link}")
        if (ROOT / path).is_dir():
            return match["text"].strip("[]")
        target = relpath(place(path), Path(uri).parent.as_posix())
        return f"{match['text']}({target}{'#' + anchor if anchor else ''})"

    parts = CODE.split(markdown)
    parts[::2] = [LINK.sub(rewrite, part) for part in parts[::2]]
    return indented("".join(parts))
