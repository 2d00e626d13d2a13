"""Make the environments that strangers live in: python environments.py FOLDER [NAME ...].

Each has the library it is named after, as tests/strangers and docs/recipes.md use it; one that is there
already is left as it is.
"""

import subprocess
import sys
from pathlib import Path

# An unpinned torch may bring gigabytes along, and releases that read each other's files are told apart here.
ENVIRONMENTS = {
    "sbi-0.22": ["torch==2.13.0", "sbi==0.22.0", "numpy<2"],
    "zuko": ["torch==2.13.0", "zuko==1.6.0", "numpy==2.4.6"],
    "lampe": ["torch==2.13.0", "zuko==1.6.0", "lampe==0.9.0", "numpy==2.4.6"],
    "flowjax": ["flowjax==19.1.2", "jax==0.10.2", "equinox==0.13.8"],
    "bayesflow": ["bayesflow==2.0.12", "keras==3.15.1", "jax==0.9.2", "scipy==1.15.3", "numpy==2.4.6"],
}


def make(folder: Path, name: str) -> None:
    """One environment, marked when it is complete."""
    done = folder / name / "complete"
    if done.exists():
        return
    subprocess.run([sys.executable, "-m", "venv", "--clear", folder / name], check=True)
    pip = [folder / name / "bin" / "python", "-m", "pip", "install", "--quiet"]
    subprocess.run([*pip, *ENVIRONMENTS[name]], check=True)
    done.touch()


if __name__ == "__main__":
    for name in sys.argv[2:] or ENVIRONMENTS:
        make(Path(sys.argv[1]), name)
