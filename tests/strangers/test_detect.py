"""The format of a file is told by its suffix and first bytes, and nothing in it is run."""

from __future__ import annotations

import io
import pickle
import sys
import types
import zipfile
from collections import OrderedDict
from pathlib import Path

import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.stranger.detect import detect


def instance_of(monkeypatch, module, name):
    """An object whose pickle names a class of a module that need not be installed."""
    made = types.ModuleType(module)
    made.__dict__[name] = type(name, (), {"__module__": module})
    for parent in [module.rsplit(".", k)[0] for k in range(1, module.count(".") + 1)]:
        monkeypatch.setitem(sys.modules, parent, types.ModuleType(parent))
    monkeypatch.setitem(sys.modules, module, made)
    return made.__dict__[name]()


def archived(content, *names):
    """As torch.save writes it, or Keras."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name in names or ("archive/data.pkl",):
            archive.writestr(name, content)
    return buffer.getvalue()


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
@pytest.mark.parametrize("wrap", [bytes, archived], ids=["pickle", "torch"])
@pytest.mark.parametrize(
    ("module", "name", "expected"),
    [
        ("sbi.inference.posteriors.direct_posterior", "DirectPosterior", "sbi_posterior"),
        ("sbi.inference.posteriors.mcmc_posterior", "MCMCPosterior", "sbi_posterior"),
        ("sbi.inference.snpe.snpe_c", "SNPE_C", "sbi_posterior"),
        ("sbi.neural_nets.estimators.nflows_flow", "NFlowsFlow", "sbi_density_estimator"),
    ],
)
def test_objects_of_sbi_are_told_apart(tmp_path, monkeypatch, protocol, wrap, module, name, expected):
    found = instance_of(monkeypatch, module, name)
    # Weights are in it too: what is outermost decides.
    for state in (OrderedDict(weight=1), None):
        found.state = state
        path = tmp_path / "file.bin"
        path.write_bytes(wrap(pickle.dumps(found, protocol=protocol)))
        assert detect(path) == expected


@pytest.mark.parametrize("wrap", [bytes, archived], ids=["pickle", "torch"])
def test_a_state_dict_is_known(tmp_path, wrap):
    path = tmp_path / "file.bin"
    path.write_bytes(wrap(pickle.dumps(OrderedDict(weight=1), protocol=2)))
    assert detect(path) == "torch_state"


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("theirs.py", b"", "python"),
        ("model.keras", b"", "bayesflow"),
        ("weights.safetensors", b"", "torch_state"),
        ("flow.eqx", b"", "jax_leaves"),
        ("leaves", b"\x93NUMPY\x01\x00", "jax_leaves"),
        ("flow.zip", archived(b"{}", "config.json", "metadata.json"), "bayesflow"),
        ("flow.zip", archived(b"{}", "config.json", "metadata.json", "model.weights.h5"), "bayesflow"),
        ("weights.pt", archived(b"\x80\x02}.", "data.pkl"), "torch_state"),
        ("weights.pt", archived(pickle.dumps({"weight": 1}, protocol=2)), "torch_state"),
    ],
)
def test_suffixes_and_first_bytes(tmp_path, name, content, expected):
    (tmp_path / name).write_bytes(content)
    assert detect(tmp_path / name) == expected


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"text",
        b"PK\x03\x04 no archive",
        archived(b"", "other"),
        archived(b"{}", "config.json"),
        pickle.dumps([1, 2]),
        *(first + b"ccollections\nOrderedDict\n)R." for first in (b"\x80\xff", b"x\x02")),
    ],
    ids=["empty", "text", "broken archive", "other archive", "half of Keras's", "other pickle", "6", "7"],
)
def test_anything_else_asks_for_the_format(tmp_path, content):
    path = tmp_path / "file.bin"
    path.write_bytes(content)
    with pytest.raises(InputError, match="--estimator-format"):
        detect(path)


def test_folders_and_missing_files(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        detect(tmp_path / "nothing.pkl")
    with pytest.raises(InputError, match=r"a folder without model\.py"):
        detect(tmp_path)
    (tmp_path / "model.py").write_text("")
    assert detect(tmp_path) == "python"


class _Touches:
    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return open, (self.path, "w")


def test_nothing_is_loaded(tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    path = tmp_path / "file.bin"
    path.write_bytes(archived(pickle.dumps(_Touches(mark), protocol=2)))
    detect(path)
    assert not mark.exists()
    with open(path, "wb") as file:
        pickle.dump(_Touches(mark), file)
    with pytest.raises(InputError):
        detect(path)
    assert not mark.exists()
