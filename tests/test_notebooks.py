"""The notebooks run from the first cell to the last, and say what they are for."""

from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "notebooks"
# name -> what must be among its results
NOTEBOOKS = {
    "compare_a_log": ["It arises in: mechanical + sensor", "'slew'", "image/png"],
    "name_a_cause": ["mechanical.coulomb_friction", "explained", "image/png"],
}
pytestmark = pytest.mark.slow


def test_every_notebook_is_run_and_kept_without_results():
    nbformat = pytest.importorskip("nbformat", reason="nbformat (extra 'dev') is not installed")
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == set(NOTEBOOKS)
    for name in NOTEBOOKS:
        cells = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4).cells
        assert all(not cell.outputs for cell in cells if cell.cell_type == "code")


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_runs(name):
    nbformat = pytest.importorskip("nbformat", reason="nbformat (extra 'dev') is not installed")
    nbclient = pytest.importorskip("nbclient", reason="nbclient (extra 'dev') is not installed")
    pytest.importorskip("ipykernel", reason="ipykernel (extra 'dev') is not installed")
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    client = nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(FOLDER)}})
    client.execute()
    shown = str([cell.outputs for cell in notebook.cells if cell.cell_type == "code"])
    for wanted in NOTEBOOKS[name]:
        assert wanted in shown, wanted
