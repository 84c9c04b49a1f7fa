import pytest
from log_files import HEADER

from cosim.logs import load_log


@pytest.fixture
def write(tmp_path):
    """Writes text or bytes as a file in a temporary folder."""

    def writer(content, name="log.csv", encoding="utf-8"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
        return path

    return writer


@pytest.fixture
def load(write):
    """Loads a log made of a header and lines, with the last line ended."""

    def loader(lines, header=HEADER, **options):
        return load_log(write(header + "\n".join(lines) + "\n"), **options)

    return loader
