"""Page that stands still: it shows views given by a test instead of those of the server, and no press is sent."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page

LEAST_RATIO: Final = 3.0
"""Least contrast between two states in one point of the picture (WCAG 2.2, 1.4.11)."""
STILL: Final = """
async () => {
  const { app } = await import("/static/app.js");
  const view = structuredClone(app.link.view);
  let status = "live";
  app.link.close();
  Object.defineProperties(app.link, { status: { get: () => status }, live: { get: () => status === "live" } });
  window.showView = (changes, linkStatus) => {
    status = linkStatus;
    app.link.view = structuredClone(view);
    for (const [section, values] of Object.entries(changes)) {
      for (const [path, value] of Object.entries(values)) {
        const keys = [section, ...path.split("/").filter(Boolean)], last = keys.pop();
        keys.reduce((node, key) => node[key], app.link.view)[last] = value;
      }
    }
    app.link.dispatchEvent(new Event("view"));
  };
  window.showView({}, "live");
}
"""
"""Script that keeps the last view of the page, and defines a function that shows it with changes."""


def stand_still(page: Page) -> None:
    page.evaluate(STILL)


def show(page: Page, changes: Mapping[str, Mapping[str, Any]], link: str = "live") -> None:
    """Show the view with changes: by section, the value at each path; the empty path is the section itself."""
    page.evaluate("([changes, link]) => window.showView(changes, link)", [changes, link])


def picture(page: Page, selector: str) -> NDArray[np.float64]:
    """Return the relative luminance of every point of an element, as it is drawn."""
    drawn = page.locator(selector).first.screenshot(animations="disabled", caret="hide")
    values = np.asarray(Image.open(io.BytesIO(drawn)).convert("RGB"), dtype=float) / 255
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    luminance: NDArray[np.float64] = linear @ np.array([0.2126, 0.7152, 0.0722])
    return luminance


def differing_points(one: NDArray[np.float64], other: NDArray[np.float64]) -> int:
    """Return the number of points with a sufficient contrast between two pictures that have one corner in common.

    Examples:
        >>> differing_points(np.array([[0.0, 1.0]]), np.array([[1.0, 0.9]]))
        1
    """
    height, width = np.minimum(one.shape, other.shape)
    a, b = one[:height, :width], other[:height, :width]
    return int(np.count_nonzero((np.maximum(a, b) + 0.05) / (np.minimum(a, b) + 0.05) >= LEAST_RATIO))
