"""The gallery of diagnoses: it shows every effect, stays small, and its command makes what is there."""

import importlib.util
import re
from pathlib import Path

import pytest
from PIL import Image

from cosim.rig import EFFECTS
from fmus import registry

TOP = Path(__file__).resolve().parents[2]
LARGEST = 300 << 10  # bytes of all pictures: they lie in the repository


@pytest.fixture(scope="module")
def gallery():
    spec = importlib.util.spec_from_file_location("make_gallery", TOP / "docs" / "make_gallery.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_effect_is_shown_with_its_picture_and_what_was_hidden(gallery):
    text = gallery.PAGE.read_text(encoding="utf-8")
    assert "**synthetic**" in text
    shown = re.findall(r"^## .* \(`([\w.]+)`\)$", text, re.M)
    assert shown == [name for name in registry.effects() if name in EFFECTS]
    assert {name for name in registry.effects() if f"`{name}`" not in text} == set()
    for name, part in zip(shown, re.split(r"^## ", text, flags=re.M)[1:], strict=False):
        assert f"| {gallery.hidden_sizes(name)} |" in part, f"python docs/make_gallery.py {name}"
        assert re.search(r"^> .*\.$", part, re.M), name
        assert f"](images/gallery/{name}.webp)" in part, name


def test_pictures_are_small_and_each_is_used(gallery):
    files = sorted(gallery.IMAGES.iterdir())
    assert sum(file.stat().st_size for file in files) < LARGEST
    text = gallery.PAGE.read_text(encoding="utf-8")
    for file in files:
        assert f"images/gallery/{file.name}" in text
        with Image.open(file) as picture:
            assert 500 < picture.width < 800


@pytest.mark.slow
def test_the_command_makes_what_is_there(gallery, tmp_path, monkeypatch):
    monkeypatch.setattr(gallery, "IMAGES", tmp_path)
    gallery.diagnose("dcv.offset", tmp_path / "found")
    made = gallery.entry("dcv.offset", tmp_path / "found").strip()
    text = gallery.PAGE.read_text(encoding="utf-8")
    (there,) = (p for p in re.split(r"^(?=## )", text, flags=re.M) if "(`dcv.offset`)" in p)

    def numbers(part):
        return [float(x) for x in re.findall(r"-?\d+\.\d+", part)]

    assert re.sub(r"[-\d.]+", "#", made) == re.sub(r"[-\d.]+", "#", there.strip())
    assert numbers(made) == pytest.approx(numbers(there), rel=0.05)
    assert (tmp_path / "dcv.offset.webp").is_file()
