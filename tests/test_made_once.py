"""What takes long is made once for all processes of a test run, whenever another one of them ends."""

from pathlib import Path

import pytest


def test_what_another_process_ends_between_two_looks_is_not_made_again(
    made_once, tmp_path, monkeypatch
) -> None:
    plain = Path.mkdir

    def late(folder: Path, *words, **options) -> None:
        if folder.name == "looked_at_begun":  # the other process is done since we looked
            plain(folder.with_name("looked_at_made"))
            (folder.with_name("looked_at_made") / "theirs").touch()
        plain(folder, *words, **options)

    monkeypatch.setattr(Path, "mkdir", late)
    found = made_once("looked_at", lambda folder: pytest.fail("it is there"))
    assert [file.name for file in found.iterdir()] == ["theirs"]


def test_each_test_has_a_copy_of_its_own(made_once) -> None:
    made = []

    def make(folder: Path) -> None:
        made.append(folder)
        (folder / "file").write_text("as it was made")

    one, other = made_once("copied", make), made_once("copied", make)
    (one / "file").write_text("changed")
    assert (other / "file").read_text() == "as it was made"
    assert len(made) == 1
