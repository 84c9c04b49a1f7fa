"""A mapping may carry the checksums of the files it was made for."""

from pathlib import Path

import pytest

from cosim.errors import DataError
from cosim.logs import load_log

MAPPING = """
[time]
column = "t"
unit = "s"
[signals.u]
column = "cmd"
unit = "1"
[sha256]
"log.csv" = "{digest}"
"""


def test_a_file_with_another_content_is_refused(tmp_path: Path) -> None:
    log, mapping = tmp_path / "log.csv", tmp_path / "map.toml"
    log.write_text("t,cmd\n0,0\n1,0.5\n2,1\n")
    mapping.write_text(MAPPING.format(digest="0" * 64))
    with pytest.raises(
        DataError, match=r"log.csv: SHA-256 [0-9a-f]{64} is not 0{64}, for which .*map.toml was made"
    ):
        load_log(log, mapping)
    other = log.rename(tmp_path / "mine.csv")  # a file of one's own may have any content
    assert len(load_log(other, mapping)) == 3


def test_a_checksum_that_is_none_is_named(tmp_path: Path) -> None:
    mapping = tmp_path / "map.toml"
    mapping.write_text(MAPPING.format(digest="abc"))
    with pytest.raises(DataError, match="sha256"):
        load_log(tmp_path / "log.csv", mapping)
