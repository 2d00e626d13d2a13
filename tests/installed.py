"""What was built is installed in an empty environment and used as a newcomer would.

``python tests/installed.py dist``
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

AUDIT = """
import numpy as np
import gaugeblock as gb

rng = np.random.default_rng(1)
theta = rng.normal(size=(1000, 1))
x = theta + rng.normal(size=theta.shape)
draws = x[:, None] / 2 + np.sqrt(0.5) * rng.normal(size=(1000, 100, 1))
result = gb.audit_draws(theta, draws, x=x, names=["level"])
assert result.outcome != "FAIL", result
assert gb.audit_draws(theta, 0.5 * draws, x=x, names=["level"]).outcome == "FAIL"
result.save("audit")
"""


def used(built: Path, folder: Path) -> None:
    """Install the file in an environment of its own, without the tree in sight, and audit with it."""
    subprocess.run([sys.executable, "-m", "venv", folder / "env"], check=True)
    programs = folder / "env" / "bin"
    install = [programs / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", built]
    for command in (
        install,
        [programs / "python", "-I", "-W", "error", "-c", AUDIT],
        [programs / "gaugeblock", "--version"],
        [programs / "gaugeblock", "verify", "audit"],
    ):
        subprocess.run(command, check=True, cwd=folder)


if __name__ == "__main__":
    files = sorted(path for path in Path(sys.argv[1]).resolve().iterdir() if path.suffix in (".whl", ".gz"))
    assert len(files) == 2, files
    for file in files:
        with tempfile.TemporaryDirectory() as place:
            used(file, Path(place))
        sys.stdout.write(f"{file.name}: installed, audited, verified\n")
