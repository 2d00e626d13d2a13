"""CPU seconds of commands that run side by side, with all that they start."""

import sys

from benchmarks.suite import said, side_by_side

BURN = "import time\nwhile time.process_time() < 0.5: pass"
CHILD = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {BURN!r}], check=True); print('done')"


def test_what_a_command_starts_is_counted_with_it(tmp_path):
    folders = [tmp_path / "busy", tmp_path / "idle"]
    for folder in folders:
        folder.mkdir()
    busy, idle = side_by_side(
        {
            folder: [sys.executable, "-c", code]
            for folder, code in zip(folders, (CHILD, "print('done')"), strict=True)
        }
    ).values()
    assert 0.5 < busy - idle < 1.5
    assert [said(folder).read_text() for folder in folders] == ["done\n", "done\n"]
    assert not any(any(folder.iterdir()) for folder in folders)
