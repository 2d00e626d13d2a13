"""Claims in words: what, how sure, how large, where; a set is never told as one name."""

from gaugeblock.discovery.result import Estimate, Identification, Region
from gaugeblock.discovery.wording import effect_phrase, effect_words, sentence

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


def test_what_the_gain_allows_is_told_with_what_it_takes():
    one, two = Identification("Fe K alpha", 6.4008, 0.1, 36.3), Identification("toy", 6.4368, 0.2, 0.3)
    apart = ", by gain or by motion, which these data do not separate."
    for near, said in (
        ((one,), f"At rest, Fe K alpha (6.4008 keV) would need +36 eV{apart}"),
        ((two,), "At rest, toy (6.4368 keV) lies within that interval."),
        (
            (two, one),
            "At rest, toy (6.4368 keV) lies within that interval and Fe K alpha (6.4008 keV) would need "
            f"+36 eV{apart}",
        ),
    ):
        assert sentence(("emission_line",), **GIVEN, near=near).endswith(f"6.57 keV. {said}")
    # Without an interval nothing lies inside one.
    unsure = {**GIVEN, "parameters": {"energy": Estimate(6.4371)}}
    assert sentence(("emission_line",), **unsure, near=(two,)).endswith(
        f"At rest, toy (6.4368 keV) would need +0 eV{apart}"
    )


def test_what_is_in_the_detector_is_there_as_recorded_and_moved_by_a_gain_alone():
    own = Identification("Al K alpha of the detector", 1.4864, 0.004, 2.0, "detector")
    told = "it would be Al K alpha of the detector (1.4864 keV; chance 0.004)."
    assert sentence(("emission_line",), **GIVEN, known=(own,)).endswith(f" As recorded {told}")
    at_rest = Identification("O K edge", 0.5431, 0.004, 2.0)
    assert " At rest it would be O K edge" in sentence(("emission_line",), **GIVEN, known=(at_rest,))
    moved = Identification("Al K alpha of the detector", 1.4864, 0.1, 12.0, "detector")
    assert sentence(("emission_line",), **GIVEN, near=(moved,)).endswith("would need +12 eV, by gain.")


def test_beside_a_gain_energies_are_not_those_recorded():
    said = sentence(("emission_line",), **GIVEN, corrected=True)
    assert "sigma 0.001 (90%, energies with that gain put right)." in said
    assert "recorded" not in said


def test_an_instruments_effect_is_told_with_the_instrument():
    assert effect_phrase("gain_slope[fpm_b]") == "a gain slope (channel energies off by a factor) of fpm_b"
    assert effect_phrase("time_bin[pn]") == "a time bin of pn"
    assert (effect_words("pileup[acis]"), effect_words("a_b[c")) == ("pileup of acis", "a b[c")


def test_a_set_is_never_told_as_one_name():
    said = sentence(("emission_line", "unnamed"), **{**GIVEN, "certain": False, "limits": ("sigma",)})
    assert said.startswith(
        "That something is there is likely (33.5 nats): an emission line or something that no effect of the "
        "library explains, one of them with a probability of 0.95; which of them these data do not say. "
        "As an emission line: energy"
    )
    assert said.endswith(
        "Its sigma stands at its limit: something larger, or of another kind, may be behind it."
    )


def test_a_long_set_is_told_by_its_first_and_their_number():
    names = [f"thing_{k}" for k in range(7)]
    assert "a thing 5 or a thing 6, one of them with" in sentence(names, **GIVEN)
    assert "a thing 3, a thing 4 or one of 3 other effects, one of them with" in sentence(
        [*names, "last"], **GIVEN
    )


def test_no_digit_is_said_that_the_data_do_not_know():
    given = {**GIVEN, "place": None, "units": {}}
    for ends, shown in (
        ((27.18, 17.304, 42.693), "27 (17 to 43)"),
        ((6.4483, 6.3545, 6.5422), "6.45 (6.35 to 6.54)"),
        ((0.32589, 0.20902, 0.48513), "0.33 (0.21 to 0.49)"),
        ((0.0, -0.04, 0.05), "0 (-0.04 to 0.05)"),
        ((5.0, 5.0, 5.0), "5 (5 to 5)"),
        ((1234.5, 1234.1, 1234.9), "1234.5 (1234.1 to 1234.9)"),
        ((3.14159265358979, 3.14159265358978, 3.14159265358981), "3.1415927 (3.1415927 to 3.1415927)"),
        ((1.0, -30.0, 40.0), "1 (-30 to 40)"),
        # Of an interval with one end nothing but the value is said.
        ((3.14159, None, 4.0), "3.14"),
        ((3.14159, 2.0, None), "3.14"),
    ):
        assert f"With a {shown} (90%" in sentence(("dip",), **{**given, "parameters": {"a": Estimate(*ends)}})


def test_what_remains_comes_after_what_is_certain():
    region = Region(3, 9, 7.0, 7.2, "keV", 9.0, 0.001)
    given = {**GIVEN, "parameters": {}, "place": (7.0, 7.2), "region": region}
    assert sentence(("unnamed",), **{**given, "beyond": True}) == (
        "Beyond that, something remains that nothing here explains: certain (0.95; 33.5 nats), most at 7 to "
        "7.2 keV, z = +9.0."
    )
    # Without a region where it acts, and in channels without a unit.
    assert sentence(("unnamed",), **{**given, "region": None}) == (
        "Something that no effect of the library explains is certain (0.95; 33.5 nats), most at 7 to 7.2 keV."
    )
    numbered = Region(3, 9, 3.0, 9.0, "channel", -4.25, 0.001)
    assert sentence(("unnamed",), **{**given, "region": numbered}).endswith(", most at 3 to 9, z = -4.2.")
    assert sentence(("unnamed",), **{**given, "region": None, "place": None}).endswith("nats).")
    both = ("unnamed", "emission_line", "pileup")
    many = (
        "That something is there is certain (33.5 nats): an emission line, pile-up or something that no "
        "effect of the library explains, one of them with a probability of 0.95; which of them these data do "
        "not say"
    )
    assert sentence(both, **given) == f"{many}; it stands out most at 7 to 7.2 keV, z = +9.0."
    assert sentence(both, **{**given, "region": None}) == f"{many}; it stands out most at 7 to 7.2 keV."
    assert sentence(both, **{**given, "region": None, "place": None}) == f"{many}."
    assert sentence(both, **{**given, "beyond": True}).startswith(
        "Beyond that, something remains that nothing"
    )
