"""A search of measured spectra tells the readers whether systematic errors are to be ignored."""

import pytest

from gaugeblock.auditing.discovering import discover
from gaugeblock.core.errors import InputError


@pytest.mark.parametrize("asked", [{}, {"ignore_sys_err": False}, {"ignore_sys_err": True}])
@pytest.mark.parametrize("many", [False, True])
def test_both_readers_are_told(tmp_path, monkeypatch, asked, many):
    from gaugeblock.simulators.xray import catalog, observation

    told = []

    def reader(what, *, ignore_sys_err, **others):
        told.append(ignore_sys_err)
        raise InputError("asked")

    monkeypatch.setattr(*((catalog, "read_catalog") if many else (observation, "read_observation")), reader)
    with pytest.raises(InputError, match="asked"):
        discover(tmp_path if many else tmp_path / "a.pha", progress=False, **asked)
    assert told == [asked.get("ignore_sys_err", False)]
