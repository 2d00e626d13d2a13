"""The notebooks run from top to bottom, as a reader would run them, and say what their text says."""

import os
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def executed(name, folder):
    """The notebook's cells after a run in a kernel of its own, with this package."""
    notebook = nbformat.read(EXAMPLES / name, as_version=4)
    nbclient.NotebookClient(notebook, timeout=1200, kernel_name="python3").execute(cwd=folder)
    return notebook.cells


def said(cells, code):
    """What the one cell with this code put on the page, as text."""
    (cell,) = (cell for cell in cells if cell.cell_type == "code" and code in cell.source)
    shown = [out for out in cell.outputs if out.output_type in ("execute_result", "display_data", "stream")]
    return "\n".join(out.get("text") or out["data"].get("text/plain", "") for out in shown)


def test_the_first_verdict(monkeypatch, tmp_path):
    pytest.importorskip("sbi")
    pytest.importorskip("matplotlib")
    monkeypatch.delenv("MPLBACKEND", raising=False)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(p for p in os.sys.path if p))
    cells = executed("first_verdict.ipynb", tmp_path)
    # What the site shows was committed: the same verdicts, whatever the last digits.
    committed = nbformat.read(EXAMPLES / "first_verdict.ipynb", as_version=4).cells
    for code in ("\nblocked.outcome", "result.outcome", "gb.audit_draws"):
        assert said(cells, code).endswith(said(committed, code))
    assert said(cells, "\nblocked.outcome").strip("<>").count("FAIL") >= 1
    assert "PASS" in said(cells, "result.outcome")
    assert "sbc.log_width[log_scatter]" in said(cells, "to_frame")
    assert "log_scatter: " in said(cells, ".message")
    (card,) = (cell for cell in cells if cell.source.endswith("\nresult"))
    assert any("text/html" in out.get("data", {}) for out in card.outputs)
    (figure,) = (cell for cell in cells if "result.plot" in cell.source)
    assert any("image/png" in out.get("data", {}) for out in figure.outputs)
    assert said(cells, "gb.audit_draws").endswith(said(cells, "result.outcome"))
