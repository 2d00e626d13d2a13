"""Errors for people."""

import sys

import pytest

from gaugeblock.errors import GaugeblockError, InputError, MissingExtraError, require


def test_require_returns_the_module():
    assert require("json", "none") is sys.modules["json"]


def test_require_names_the_extra():
    with pytest.raises(MissingExtraError, match=r"pip install 'gaugeblock\[sbi\]'") as caught:
        require("no_such_library_at_all", "sbi")
    assert "\n" not in str(caught.value)


def test_require_lets_a_library_s_own_trouble_through(tmp_path, monkeypatch):
    (tmp_path / "needs_another.py").write_text("import a_library_it_forgot_to_declare\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="a_library_it_forgot_to_declare") as caught:
        require("needs_another", "sbi")
    assert not isinstance(caught.value, MissingExtraError)


def test_kinds_fit_the_builtin_ones():
    assert issubclass(InputError, ValueError)
    assert issubclass(MissingExtraError, ImportError)
    assert issubclass(InputError, GaugeblockError)
    assert issubclass(MissingExtraError, GaugeblockError)
