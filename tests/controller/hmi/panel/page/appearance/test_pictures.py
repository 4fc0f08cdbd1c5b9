"""Pictures of the panel in the documentation."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from tests.controller.hmi.panel.page.appearance import pictures


def test_the_pictures_show_the_present_page() -> None:
    stored = (pictures.FOLDER / pictures.CHECKSUM).read_text(encoding="utf-8").strip()
    assert stored == pictures.checksum(), f"the page has changed; run: {pictures.COMMAND}"


def test_every_picture_has_the_size_of_its_scene_and_no_other_is_kept() -> None:
    sizes = {}
    for path in pictures.FOLDER.glob("panel-*.png"):
        with Image.open(path) as picture:
            sizes[path.stem] = picture.size
    assert sizes == {scene.name: scene.size for scene in pictures.SCENES}


@pytest.mark.nightly
def test_a_picture_is_taken(tmp_path: Path) -> None:
    scene = pictures.Scene("held", "held", "recovery", language="zh", theme="night")
    pictures.write(tmp_path, (scene,))
    with Image.open(tmp_path / "held.png") as picture:
        assert picture.size == scene.size
        assert len(picture.convert("RGB").getcolors(maxcolors=1 << 20) or []) > 50, "something is drawn"
