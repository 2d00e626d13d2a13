"""A notebook as a page, with the outputs that it was committed with.

``python docs/_site/notebook.py examples/first_verdict.ipynb`` runs it and writes these outputs.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any


def as_page(path: Path) -> str:
    """Markdown of all cells, code in fences, outputs behind it."""
    return "\n\n".join(_blocks(json.loads(path.read_text(encoding="utf-8"))["cells"])) + "\n"


def _blocks(cells: list[Mapping[str, Any]]) -> Iterator[str]:
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            yield source
        else:
            yield f"```python\n{source}\n```"
            yield from (shown for output in cell["outputs"] if (shown := _output(output)))


def _output(output: Mapping[str, Any]) -> str:
    if output["output_type"] == "stream":
        return ""  # what libraries say on the way
    data: Mapping[str, list[str] | str] = output["data"]
    if "image/png" in data:
        return f"![Drawn by the cell above](data:image/png;base64,{''.join(data['image/png']).strip()})"
    return f"```text\n{''.join(data['text/plain'])}\n```"


def kept(cells: list[Any]) -> None:
    """Leave of every cell's outputs what a page shows: results as text, and figures."""
    for cell in cells:
        cell["metadata"] = {}
        if cell["cell_type"] == "code":
            cell["execution_count"] = None
            cell["outputs"] = [
                output
                for output in cell["outputs"]
                if output["output_type"] == "execute_result" or "image/png" in output.get("data", {})
            ]
            for output in cell["outputs"]:
                shown = "image/png" if "image/png" in output["data"] else "text/plain"
                output["data"] = {shown: output["data"][shown]}
                if "execution_count" in output:
                    output["execution_count"] = None


if __name__ == "__main__":
    import nbclient
    import nbformat

    for name in sys.argv[1:]:
        notebook = nbformat.read(name, as_version=4)
        nbclient.NotebookClient(notebook, timeout=1200, kernel_name="python3").execute()
        kept(notebook.cells)
        notebook.metadata = {key: notebook.metadata[key] for key in ("kernelspec",)}
        nbformat.write(notebook, name)
