"""Errors for people."""

import sys

import pytest

from gaugeblock.core.errors import (
    GaugeblockError,
    InputError,
    MissingExtraError,
    blamed,
    one_line,
    printable,
    require,
)


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


def test_who_failed_is_blamed_and_what_we_say_ourselves_is_not():
    with (
        pytest.raises(InputError, match=r"^the author's flow failed on trials 3 to 5: OSError: a \?\[31m b$"),
        blamed("the author's flow", range(3, 6)),
    ):
        raise OSError("a\n\x1b[31m b")
    with pytest.raises(InputError) as caught, blamed("it", range(2)):
        raise ValueError("x" * 10_000)
    assert 300 < len(str(caught.value)) < 400
    ours = MissingExtraError("install it")
    with pytest.raises(MissingExtraError) as passed, blamed("it", range(2)):
        raise ours
    assert passed.value is ours


def test_an_error_without_words_says_where_it_was_raised(tmp_path):
    flow = tmp_path / "flow.py"
    flow.write_text("x = 0\nassert x > 0\n")
    said = r"^it failed on data of shape \(2,\): AssertionError: assert x > 0 \(flow.py, line 2\)$"
    with pytest.raises(InputError, match=said), blamed("it", "data of shape (2,)"):
        exec(compile(flow.read_text(), flow, "exec"), {})


@pytest.mark.parametrize(
    "letter", [*map(chr, range(32)), "\x7f", "\x9b", "\u202e", "\u2028", "\u200b", "\ud800"]
)
def test_nothing_that_commands_a_terminal_is_left(letter):
    line = one_line(f"a{letter}b")
    assert line in ("a b", "a?b")
    assert line.encode().decode() == line
    kept = {"\n", "\t"}
    assert set(printable(f"a{letter}b")) <= {"a", "b", " ", "?", *kept & {letter}}


def test_words_of_any_language_stay():
    assert one_line("naïve Größe 硬 μ ± 3σ →") == "naïve Größe 硬 μ ± 3σ →"


def test_kinds_fit_the_builtin_ones():
    assert issubclass(InputError, ValueError)
    assert issubclass(MissingExtraError, ImportError)
    assert issubclass(InputError, GaugeblockError)
    assert issubclass(MissingExtraError, GaugeblockError)


def test_long_words_are_cut_to_the_letter():
    assert one_line("abcdef", most=6) == "abcdef"
    assert one_line("abcdefg", most=6) == "abc..."
    assert one_line("a" * 1000) == "a" * 1000
