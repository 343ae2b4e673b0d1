"""The notebook runs, finds the true camera, and is committed without outputs."""

import re
from importlib import resources

import nbformat
import pytest
from nbclient import NotebookClient
from shown import DOCS

NOTEBOOK = DOCS / "notebook.ipynb"


@pytest.fixture
def notebook():
    return nbformat.read(NOTEBOOK, as_version=4)


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def test_it_is_committed_without_outputs(notebook):
    cells = code_cells(notebook)
    assert len(cells) > 5
    assert all(cell.outputs == [] and cell.execution_count is None for cell in cells)


def run(notebook):
    """Execute it; return the output of its cells, and its number of pictures."""
    pytest.importorskip("ipykernel", reason="needs Python 3.11")
    NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    outputs = [output for cell in code_cells(notebook) for output in cell.outputs]
    texts = "".join(output.text for output in outputs if "text" in output)
    return texts, sum("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.slow
def test_it_runs_and_comes_to_the_truth(notebook):
    texts, pictures = run(notebook)
    assert pictures == 4
    errors = [float(text) for text in re.findall(r"([+-][\d.]+) standard deviations", texts)]
    assert len(errors) == 4
    assert max(map(abs, errors)) < 4
    lengths = re.findall(r"([\d.]+) \+- ([\d.]+) mm", texts)
    for (length, std), true in zip(lengths, (118.794, 71.276), strict=True):
        assert abs(float(length) - true) < 4 * float(std)


@pytest.mark.slow
def test_it_runs_as_it_stands_with_a_photograph_of_ones_own(notebook):
    first = code_cells(notebook)[0]
    with resources.as_file(resources.files("trisquare") / "data" / "demo.png") as path:
        assert "own = None" in first.source
        first.source = first.source.replace("own = None", f"own = {str(path)!r}")
        texts, pictures = run(notebook)
    assert pictures == 4
    assert not re.search(r"px, [+-][\d.]+ standard deviations", texts)
    lengths = re.findall(r"([\d.]+) \+- ([\d.]+) mm", texts)
    ((length, std),) = lengths
    assert abs(float(length) - 84 * 2**0.5) < 4 * float(std)
