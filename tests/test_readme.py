"""What the README says was measured is what the pages say that are made of the measurements."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
NUMBER = r"([+-]?\d+(?:\.\d+)?)"


def flat(text):
    """In one line, thousands without their commas, nothing bold."""
    return re.sub(r"(?<=\d),(?=\d{3})", "", " ".join(text.replace("**", "").split()))


def page(name):
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def table(name, block):
    """Rows of cells that a study writes between its marks, without the heading, and the line below them."""
    text = page(name).partition(f"<!-- {block} -->\n")[2].partition(f"\n<!-- /{block} -->")[0]
    lines = text.splitlines()
    rows = [[cell.strip() for cell in flat(line).strip("|").split("|")] for line in lines if line[:1] == "|"]
    assert len(rows) > 2
    return rows[2:], flat(" ".join(line for line in lines if line[:1] != "|"))


README = flat((ROOT / "README.md").read_text(encoding="utf-8"))


def said(pattern, text=README):
    """The numbers of the one place that a pattern matches, as they are written; # stands for each."""
    (found,) = re.findall(pattern.replace("#", NUMBER), text)
    return found if isinstance(found, tuple) else (found,)


def same(written, measured):
    """A number that is written is what was measured, to its last digit."""
    digits = len(written.partition(".")[2])
    return f"{float(written):.{digits}f}" == f"{float(measured):.{digits}f}"


def rate(cell):
    return float(re.match(NUMBER, cell).group())


def test_verdicts_on_the_edge_of_a_tolerance():
    rows, below = table("error-rates.md", "gate")
    edges = [
        [number for cell in cells for number in said(r"^#% \(# to #\)", cell)]
        for case, *cells in rows
        if case != "exact"
    ]
    each, fail, passed, *limits = said(
        r"on the edge of a tolerance, # each \| FAIL in at most #%, PASS in at most #%, as observed; "
        "with 95% limits of at most #% and #%"
    )
    assert (each,) == said("; # replicates of each", below)
    most = [max(float(edge[column]) for edge in edges) for column in (0, 3, 2, 5)]
    for written, measured in zip((fail, passed, *limits), most, strict=True):
        assert same(written, measured)
    assert len(edges) == 7


def test_sizes_of_p_values():
    rows, below = table("error-rates.md", "size")
    rates = [rate(cell) for row in rows for cell in row[1:] if cell]
    number, each, most = said(r"rejections at 5% of # p-values on exact posteriors, # each \| at most #%")
    assert int(number) == len(rates)
    assert (each,) == said("; # replicates of each", below)
    assert same(most, max(rates))


def test_faults_that_are_named():
    found = {(row[0], row[1]): row[3] for row in table("hidden-faults.md", "faults aims")[0]}
    fair = said("#% of #", found["a fair fault is named", "called again"])
    sound = said("#% of #", found["something is named in a sound estimator", "called again"])
    lacks = said("#% of #", found["one wrong name for what the library lacks", "called again"])
    share, number, sound_number, wrong, of = said(
        "named rightly in #% of #; a fault was named in one of # sound ones, and one wrong name given to "
        "what the library lacks in # of #"
    )
    assert same(share, fair[0])
    assert (number, sound_number, of) == (fair[1], sound[1], lacks[1])
    assert same(f"{100 / int(sound_number):.1f}", sound[0])
    assert same(f"{100 * int(wrong) / int(of):.1f}", lacks[0])


def test_flows_that_are_mended():
    found = {row[0]: said("#% of #", row[1]) for row in table("cures.md", "cures trial")[0]}
    number, cured, runner = said(
        "Of # flows that FAIL because one thing was wrong in their training, #% PASS when they are trained "
        "again with the cures that were named, none with another seed alone, and #% with the cures of the "
        "runner-up"
    )
    assert (cured, number) == found["the cures of what was named"]
    assert (runner, number) == found["the cures of the runner-up"]
    assert ("0", number) == found["nothing, but for another seed (placebo)"]


def test_effects_that_are_named():
    """Of the sealed set as it is searched today, and beside it of 0.1.0."""
    whole, old = (
        said("# of # sealed cases, # hours", table("hidden-effects.md", block)[1])[:2]
        for block in ("today targets", "spectra targets")
    )
    then, today, paired, sure = (
        {row[0]: row[1:] for row in table("hidden-effects.md", block)[0]}
        for block in ("spectra targets", "today targets", "today paired", "today reliability")
    )
    (sealed,) = said("Of # sealed spectra, in most of which")
    assert (sealed, sealed) == old == whole
    fair = "eligible cases named correctly, averaged per effect"
    named, low, high, fit = said(r"named rightly in #% \(# to #\) of # cases that count")
    assert fit == today[fair][1] == then[fair][1]
    for written, measured in zip((named, low, high), said(r"^#% \(# to #\)", today[fair][2]), strict=True):
        assert same(written, measured)
    (share,) = said("Version 0.1.0 named #%")
    assert same(share, rate(then[fair][2]))
    both, alone, before, p = said(
        r"of # effects that both searched # right names stand alone now where # did \(p = (\S+)\)"
    )
    one, two = paired["the right name, alone"], paired["the right name, alone or one of two"]
    assert [both, before, alone, p] == [*one[:3], one[-1]]
    assert said("alone or as one of two it is #, and was #") == (two[2], two[1])
    empty, unknown = (
        said("A name was given in # of # in which"),
        said("wrong one in # of # whose effect no library"),
    )
    for (count, cases), row in (
        (empty, "a name given where nothing is hidden"),
        (unknown, "a confident wrong name for what the library lacks"),
    ):
        assert cases == today[row][1]
        assert f"{100 * int(count) / int(cases):.1f}" == said("^#%", today[row][2])[0]
    stated, hold, printed = said("Of # statements that are certain # hold, printed at #")
    assert (stated, printed) == (sure["certain"][0], str(float(sure["certain"][1])))
    assert f"{100 * int(hold) / int(stated):.1f}" == said("^#%", sure["certain"][2])[0]
    later = {row[0]: row[1:] for row in table("hidden-effects.md", "fresh reliability")[0]}["certain"]
    held, stated, printed = *said("and # of # in a set that was sealed later"), said("printed at #, and")[0]
    assert (stated, printed) == (later[0], str(float(later[1])))
    assert f"{100 * int(held) / int(stated):.1f}" == said("^#%", later[2])[0]


def test_headlines_of_measured_spectra():
    name, strong, silent, wrong = table("measured.md", "measured headlines")[0][-1]
    assert name == "together"
    right, number, low, high = said(r"holds the answer in # of # strong cases \(#% to #%\)")
    assert strong == f"{right} of {number} ({low}% to {high}%)"
    quiet, of = said(r"# of # \(", silent)
    assert quiet == of == said(r"nothing is certain in # controls")[0]
    assert said(r"# of # \(", wrong) == ("0", said(r"is wrong in any of # searches")[0])


def test_false_alarms_where_nothing_is_hidden():
    rows = {row[0]: row[1:] for row in table("measured.md", "measured nulls")[0]}
    number, alarms, _, certain = rows["all"]
    spectra, low, sure = said(
        "Of # simulated spectra that their model describes, through the responses of seven instruments, "
        "# have a global p below 0.01, and in # something was certain"
    )
    assert spectra.replace(",", "") == number
    assert (low, sure) == (alarms.split()[0], certain.split()[0])
    tools = [name for name in rows if name.isupper() or name in ("EPIC-pn", "EPIC-MOS", "ACIS, early")]
    assert len(tools) == 7


def test_the_shared_score():
    """Every row of the README's table is one of the page's, of the gain that was published."""
    rows, _ = table("gain.md", "schemes")
    measured = {row[0]: [*row[1:4], *row[6:8]] for row in rows}
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = re.findall(r"^\| ([\w ]+), (?:AUC|z) \| (.*) \|$", text, flags=re.MULTILINE)
    for name, cells in lines:
        assert [cell.strip() for cell in flat(cells).split("|")] == [
            cell.replace("+", "").strip() for cell in measured[name]
        ]
    assert {name for name, _ in lines} == {
        *("predictive check", "population C2ST", "importance ESS", "paired evidence", "shared score")
    }


def test_the_bright_flow():
    measured = [row[6:8] for row in table("training.md", "shipped flows")[0] if row[0] == "`epic-pn-bright`"]
    ((verdict, efficiency),) = measured
    shares = said(
        "shipped bright flow .*? median effective fraction \\| # \\(95%: #-#\\), strict policy PASS"
    )
    assert verdict == "PASS, strict, 20000 trials"
    for share, percent in zip(shares, said(r"^#% \(#% to #%\)", efficiency), strict=True):
        assert same(share, float(percent) / 100)


def test_flows_beyond_what_is_tolerated():
    rows = [row for row in table("training.md", "shipped flows")[0] if row[8]]
    every = {(row[0], *said(r"^# \(.*?\) of #$", row[8])) for row in rows}
    measured = {one for one in every if abs(float(one[1])) > float(one[2])}
    bad = said(
        "medium # and bright # of #, any exposure # of #, NICER medium # of #, bright with a free gain # of #"
    )
    medium, bright, strict, exposures, strict_too, nicer, default, gain, default_too = bad
    assert measured == {
        ("`epic-pn-medium`", medium, strict), ("`epic-pn-bright`", bright, strict),
        ("`epic-pn-exposures`, 1080 to 10800 s", exposures, strict_too), ("`nicer-medium`", nicer, default),
        ("`epic-pn-bright-gain`", gain, default_too),
    }  # fmt: skip


def test_peers():
    ratios = {row[0]: row[4] for row in table("peers.md", "peers")[0]}
    names = ("simultaneous ECDF band", "MMD", "expected coverage", "PSIS", "thread bootstrap")
    shares = said(
        "released peers, time over ours: ECDF bands, MMD null, expected coverage, PSIS, thread bootstrap "
        r"\| #, #, #, #, #"
    )
    for share, name in zip(shares, names, strict=True):
        (measured,) = [ratio for task, ratio in ratios.items() if task.startswith(name)]
        assert same(share, measured)


def test_the_published_study():
    measured = said("Of # judged claims # agree, # differ, # are undecided", flat(page("reproduction.md")))
    assert measured == said(r"the published study: # claims .*? \| # agree .*?, # differ, # are undecided")


@pytest.mark.parametrize(
    ("written", "measured", "other"), [("2.4", 2.44, 2.46), ("0.9", "0.90", "0.84"), ("-5", "-5.2", "5.2")]
)
def test_a_number_is_compared_to_its_last_digit(written, measured, other):
    assert same(written, measured)
    assert not same(written, other)
