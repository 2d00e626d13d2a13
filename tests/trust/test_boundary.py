"""Files from elsewhere have one way in: nothing else in the house opens, inflates or parses them."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOMS = (
    "src/gaugeblock",
    "validate",
    "estimators",
    "simulators",
    "discover",
    "diagnose",
    "reports",
    "stranger",
)
PARSERS = {
    "np.load", "json.load", "pickle.load", "pickle.loads", "pickle.Unpickler", "torch.load", "gzip.open",
    "zipfile.ZipFile", "netCDF4.Dataset", "xr.open_groups", "xr.open_dataset", "xr.open_datatree",
    "fits.open", "tomllib.load", "tarfile.open", "yaml.load", "h5py.File",
}  # fmt: skip
# What a file may call and why: the one reader; what was written here or came by a digest; what runs in, or
# reads for, the sandbox, with budgets of its own.
ALLOWED = {
    "src/gaugeblock/core/executors.py": {"pickle.Unpickler"},  # between processes of one run
    "src/gaugeblock/core/foreign.py": {"zipfile.ZipFile", "fits.open"},
    "validate/storage.py": {"netCDF4.Dataset", "xr.open_groups", "xr.open_dataset"},
    "src/gaugeblock/auditing/trials_from/reading.py": {"netCDF4.Dataset"},
    "estimators/npe/bank.py": {"np.load"},
    "simulators/xray/data.py": {"zipfile.ZipFile"},
    "stranger/detect.py": {"zipfile.ZipFile"},
    "stranger/listing.py": {"zipfile.ZipFile"},
}


def calls(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    nodes = list(ast.walk(tree))
    bases = {ast.unparse(base) for node in nodes if isinstance(node, ast.ClassDef) for base in node.bases}
    return bases | {ast.unparse(node.func) for node in nodes if isinstance(node, ast.Call)}


def test_only_the_one_reader_parses_files() -> None:
    found = {}
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            if "child" in path.parts or path.is_symlink():
                continue
            name = path.relative_to(ROOT).as_posix()
            if used := calls(path) & PARSERS:
                found[name] = used
    assert found == ALLOWED
