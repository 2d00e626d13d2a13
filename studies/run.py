"""The study from a shell: ``python studies/run.py --all``; ``--help`` says the rest."""

import runpy
import sys
from pathlib import Path

if __name__ == "__main__":
    # Started as a file: not this folder but the one it lies in has to be importable.
    sys.path[0] = str(Path(__file__).resolve().parent.parent)
    runpy.run_module("studies", run_name="__main__", alter_sys=True)
