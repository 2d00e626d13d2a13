"""What is imported when: a command line that answers at once, rooms that need the core install only."""

import importlib.util
import os
import subprocess
import sys

import pytest

EXTRAS = (
    "astropy", "cloudpickle", "cryptography", "dask", "distributed", "jax", "jaxlib", "jaxspec", "matplotlib",
    "numpyro", "pooch", "safetensors", "sbi", "torch", "ultranest", "zuko",
)  # fmt: skip

# Refuses the extras as if they were not installed, wherever they are.
WITHOUT_EXTRAS = f"""
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {EXTRAS!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Refuse())
# Who only asks whether one is there is told that it is not.
import importlib.util
found = importlib.util.find_spec
extra = {EXTRAS!r}
importlib.util.find_spec = lambda name, *more: None if name.split(".")[0] in extra else found(name, *more)
"""


def python(code, **environment):
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


HELP = """
import sys
sys.argv = ["gaugeblock", "--help"]
from gaugeblock.cli import main
try:
    main()
except SystemExit as done:
    assert not done.code, done.code
"""


def test_help_answers_within_half_a_second():
    # The best of several, in CPU time: what is measured is our imports, not what else the machine is doing.
    def seconds():
        before = os.times()
        python(HELP)
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system

    assert any(seconds() < 0.5 for _ in range(7))


def test_help_imports_no_heavy_library():
    heavy = {"torch", "jax", "sbi", "jaxspec", "scipy", "xarray", "ultranest", "numpyro", "matplotlib"}
    out = python(HELP + "print('LOADED', *{module.split('.')[0] for module in sys.modules})")
    assert "Usage" in out
    assert not heavy & set(out.rsplit("LOADED", 1)[1].split())


ROOMS = (
    "gaugeblock",
    "gaugeblock.simulators",
    "gaugeblock.estimators",
    "gaugeblock.validate",
    "gaugeblock.reports",
    "gaugeblock.auditing.audit",
    "gaugeblock.cli",
)


def test_every_room_opens_with_the_core_install_and_before_any_other():
    python(
        f"{WITHOUT_EXTRAS}\n"
        "import importlib\n"
        f"for module in {ROOMS!r}:\n"
        "    for name in [name for name in sys.modules if name.split('.')[0] == 'gaugeblock']:\n"
        "        del sys.modules[name]\n"
        "    importlib.import_module(module)\n"
    )


def test_importing_every_room_imports_neither_torch_nor_jax():
    rooms = "simulators", "simulators.xray", "estimators", "validate", "reports"
    code = "import sys\n" + "".join(f"import gaugeblock.{room}\n" for room in rooms)
    loaded = python(code + "print(*sys.modules)").split()
    assert not {"torch", "jax", "sbi", "jaxspec", "ultranest", "numpyro"} & set(loaded)


def test_a_missing_extra_is_named():
    code = (
        WITHOUT_EXTRAS
        + "from gaugeblock.core.errors import MissingExtraError\n"
        + "from gaugeblock.simulators import build_simulator\n"
        + "try: build_simulator('xray')\n"
        + "except MissingExtraError as error: print(error)\n"
        + "from pathlib import Path\nfrom gaugeblock.auditing.attest import attest\n"
        + "try: attest(Path('.'), Path('key.pem'))\nexcept ImportError as error: print(error)\n"
    )
    said = python(code).splitlines()
    assert "pip install 'gaugeblock[xray]'" in said[0]
    assert "pip install 'gaugeblock[sign]'" in said[-1]


@pytest.mark.skipif(os.environ.get("GAUGEBLOCK_CORE_ONLY") != "1", reason="only in tox's environment `core`")
def test_the_core_install_is_small():
    assert not [name for name in EXTRAS if importlib.util.find_spec(name)]
