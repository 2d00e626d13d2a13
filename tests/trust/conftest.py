"""Files that somebody made to do harm; `pytest.mark.attack(what, outcome)` puts a test into docs/trust.md.

They were made with h5py out of `sound.nc`, Trials of 12 trials, each with its x replaced: `external` by
external storage in secret.bin, `virtual` by a virtual dataset over secret.h5, `link` by an external link to
it; `dense` has such a link among thirty members of a group, `soft` one inside the file, `bomb` a chunk that
inflates to 40 MB, `filter` a filter of a plugin's, `latest` and `userblock` a younger layout and 512 bytes
before the file.
"""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

HOSTILE = Path(__file__).parent / "hostile"


@pytest.fixture
def hostile(tmp_path: Path) -> Callable[[str], Path]:
    """A hostile file by its name, beside the secret that it is after."""
    (tmp_path / "secret.bin").write_bytes(np.arange(1.0, 25.0).tobytes())

    def unpacked(name: str) -> Path:
        path = tmp_path / f"{name}.nc"
        path.write_bytes(gzip.decompress((HOSTILE / f"{name}.nc.gz").read_bytes()))
        return path

    return unpacked
