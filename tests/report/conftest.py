from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def diagnosed(rubbing) -> Path:
    """Folder of one real diagnosis with its report: Coulomb friction hidden in 25 s of the rig."""
    pytest.importorskip("plotly", reason="the extra 'report' is not installed")
    pytest.importorskip("jinja2", reason="the extra 'report' is not installed")
    return rubbing
