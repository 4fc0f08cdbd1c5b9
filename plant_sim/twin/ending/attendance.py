"""Presence of an operator at the page of a panel."""

from __future__ import annotations

import re
from urllib.error import URLError
from urllib.request import urlopen

_ANSWER_S = 2.0
_PAGES = re.compile(r"^\w+_panel_clients (\d+)", re.MULTILINE)


def has_open_page(panel: str) -> bool:
    """Return True if a browser shows the page of a panel.

    Args:
        panel: Line with the address of the panel; empty if there is no panel. A panel that does not answer has no page.
    """
    _, _, address = panel.partition("http://")
    if not address:
        return False
    try:
        with urlopen(f"http://{address.split()[0].rstrip('/')}/metrics", timeout=_ANSWER_S) as answer:
            pages = _PAGES.search(answer.read().decode())
    except (URLError, OSError):
        return False
    return pages is not None and int(pages[1]) > 0
