import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.core.settings import apply_settings, parse_settings


def test_values_are_read_as_toml_and_else_as_text() -> None:
    parsed = parse_settings(
        ["a.b=3", "a.c=tbabs*(powerlaw)", "a.d=[0.5, 8.0]", "a.e=true", "f='x=y'", "g.h= z ", " i =5"]
    )
    assert parsed == {
        "a.b": 3, "a.c": "tbabs*(powerlaw)", "a.d": [0.5, 8.0], "a.e": True, "f": "x=y", "g.h": "z", "i": 5,
    }  # fmt: skip


@pytest.mark.parametrize("entry", ["nothing", "=3", "a..b=3", ".a=1"])
def test_what_is_no_setting_says_how_one_looks(entry: str) -> None:
    with pytest.raises(InputError, match=r"expected table\.key=value"):
        parse_settings([entry])


def test_settings_leave_the_original_alone() -> None:
    table = {"a": {"b": {"c": 1}}}
    assert apply_settings(table, {"a.b.d": 2}) == {"a": {"b": {"c": 1, "d": 2}}}
    assert table == {"a": {"b": {"c": 1}}}


def test_a_key_through_a_value_is_refused() -> None:
    with pytest.raises(InputError, match="a is a value, not a table"):
        apply_settings({"a": 1}, {"a.b": 2})
