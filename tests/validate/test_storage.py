from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import xarray as xr

from gaugeblock.validate.storage import read_groups, write_groups


def test_several_threads_may_write_and_read_at_once(tmp_path: Path) -> None:
    """The libraries below are not made for it, and end the process."""

    def both(number: int) -> bool:
        rows = np.random.default_rng(number).random((50, 40))
        whole = xr.Dataset({"draws": (("trial", "draw"), rows)})
        parts = (whole.isel(trial=slice(k, k + 10)) for k in range(0, 50, 10))
        write_groups({"": parts}, tmp_path / f"{number}.nc")
        return read_groups(tmp_path / f"{number}.nc", what="Trials")[""].identical(whole)

    with ThreadPoolExecutor(8) as threads:
        assert all(threads.map(both, range(60)))
