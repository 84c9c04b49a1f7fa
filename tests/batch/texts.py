"""Small files of the tests of batches; needs no extra."""

from pathlib import Path


def write(path: Path, text: str) -> Path:
    """The file, with this text in it."""
    path.write_text(text, encoding="utf-8")
    return path
