"""Claims in words: what, how sure, how large, where; a set is never told as one name."""

from gaugeblock.discovery.result import Estimate, Region
from gaugeblock.discovery.wording import sentence

GIVEN = {
    "evidence": 33.5, "certain": True, "probability": 0.95, "units": {"energy": "keV"},
    "parameters": {"energy": Estimate(6.4371, 6.4350, 6.4392), "sigma": Estimate(0.001)},
    "place": (6.31, 6.57), "region": None, "limits": (), "beyond": False,
}  # fmt: skip


def test_a_name_alone_is_a_sentence_with_its_size_and_place():
    assert sentence(("emission_line",), **GIVEN) == (
        "An emission line is certain (0.95; 33.5 nats). With energy 6.4371 (6.435 to 6.4392) keV, "
        "sigma 0.001 (90%, energies as recorded). It acts at 6.31 to 6.57 keV."
    )


def test_a_set_is_never_told_as_one_name():
    said = sentence(("emission_line", "unnamed"), **{**GIVEN, "certain": False, "limits": ("sigma",)})
    assert said.startswith(
        "That something is there is likely (0.95; 33.5 nats): an emission line or something"
    )
    assert "which of them these data do not say. As an emission line: energy" in said
    assert said.endswith(
        "Its sigma stands at its limit: something larger, or of another kind, may be behind it."
    )


def test_what_remains_comes_after_what_is_certain():
    region = Region(3, 9, 7.0, 7.2, "keV", 9.0, 0.001)
    given = {**GIVEN, "parameters": {}, "place": (7.0, 7.2), "region": region}
    assert sentence(("unnamed",), **{**given, "beyond": True}) == (
        "Beyond that, something remains that nothing here explains: certain (0.95; 33.5 nats), most at 7 to "
        "7.2 keV, z = +9.0."
    )
    assert sentence(("unnamed", "emission_line"), **given).startswith(
        "Something that no effect of the library"
    )
