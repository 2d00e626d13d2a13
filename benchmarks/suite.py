"""CPU seconds of `tox -e tests` at several commits, side by side: python -m benchmarks.suite 695ab96 HEAD.

Each commit is cloned, its environment made beforehand, and nothing is cached. Then all run at the same time,
each with one worker, so that what else the machine does meets all of them alike. Prints a table in Markdown,
and how much more the last commit takes than the first; `--out` keeps clones and what pytest said.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TOX = (sys.executable, "-m", "tox", "-q", "-e", "tests")
TESTS = ("--", "-n", "1", "tests", "property_tests")


def cloned(commit: str, folder: Path) -> Path:
    """A clone of this repository at a commit, with an environment in which its tests can run."""
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(folder)], check=True)
    subprocess.run(["git", "checkout", "--quiet", "--detach", commit], cwd=folder, check=True)
    subprocess.run([*TOX, "--notest"], cwd=folder, check=True)
    return folder


def said(folder: Path) -> Path:
    """What a command in a clone said: beside it, whose own files are looked at by tests."""
    return folder.with_name(f"{folder.name}-said.txt")


def side_by_side(commands: dict[Path, list[str]]) -> dict[Path, float]:
    """CPU seconds of a command in each folder, all that it started included; each writes to `said` of it."""
    begun: dict[int, tuple[Path, subprocess.Popen[bytes]]] = {}
    for folder, command in commands.items():
        with said(folder).open("w") as out:
            mine = {**os.environ, "XDG_CACHE_HOME": str(folder.with_name(f"{folder.name}-cache"))}
            process = subprocess.Popen(command, cwd=folder, env=mine, stdout=out, stderr=subprocess.STDOUT)
        begun[process.pid] = folder, process
    found = {}
    while begun:
        pid, status, used = os.wait4(-1, 0)
        if pid in begun:
            folder, process = begun.pop(pid)
            process.returncode = os.waitstatus_to_exitcode(status)
            found[folder] = used.ru_utime + used.ru_stime
    return {folder: found[folder] for folder in commands}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("commits", nargs="+")
    parser.add_argument("--out", type=Path, help="keep clones here: a folder that is not there yet")
    given = parser.parse_args()
    named = {
        commit: subprocess.check_output(["git", "rev-parse", commit], cwd=ROOT, text=True).strip()
        for commit in given.commits
    }
    with tempfile.TemporaryDirectory() as temporary:
        parent = (given.out or Path(temporary)).resolve()
        folders = {commit: cloned(digest, parent / digest[:7]) for commit, digest in named.items()}
        seconds = side_by_side({folder: [*TOX, *TESTS] for folder in folders.values()})
        print("| commit | CPU seconds | pytest's last word |\n|---|---|---|")
        for folder in folders.values():
            words = [line for line in said(folder).read_text().splitlines() if " passed" in line]
            print(f"| {folder.name} | {seconds[folder]:.0f} | {' '.join(words[-1:]).strip('= ')} |")
    first, last = seconds[folders[given.commits[0]]], seconds[folders[given.commits[-1]]]
    print(f"\nThe last takes {last / first - 1:+.0%} of the first's.")


if __name__ == "__main__":
    main()
