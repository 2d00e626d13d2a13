import re
from dataclasses import replace

import numpy as np
import pytest
from tests.reports.parsed import Page

from gaugeblock.auditing.diagnosing import with_diagnosis
from gaugeblock.diagnosis.cases import thirds
from gaugeblock.reports import report_html
from gaugeblock.reports.answers import UNNAMED
from gaugeblock.reports.html import by_reason
from gaugeblock.reports.mended import before_and_after
from gaugeblock.reports.worst import in_worst_regions, trial_errors
from gaugeblock.validate import Outcome, main_trials, make_trials, run_validators, trials_tree


def page_of(audit, title="An audit") -> Page:
    return Page(report_html(audit.verdict, audit.findings, audit.trials, title=title))


def test_the_page_is_well_formed_and_its_ids_are_unique(audit):
    page = page_of(audit)
    assert page.astray == []
    assert page.open == []
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    targets = {a["href"].removeprefix("#") for tag, a in page.tags if tag == "a"}
    assert targets <= set(ids), "a link of the page leads nowhere"


def test_verdict_gates_messages_and_provenance_are_on_it(audit):
    page = page_of(audit)
    assert f"{audit.verdict.outcome.value}" in page.text
    for gate in audit.verdict.gates:
        assert " ".join(gate.message.split()) in page.text
    for item in audit.verdict.not_checked:
        assert item.id in page.text
        assert item.why in page.text
    assert "abababab" in page.text
    assert "error_budget = 0.05" in page.text


def test_nothing_is_loaded_from_anywhere_and_nothing_runs(audit):
    text = report_html(audit.verdict, audit.findings, audit.trials, title="x")
    page = Page(text)
    assert not {tag for tag, _ in page.tags} & {"script", "iframe", "img", "object", "embed", "base", "form"}
    for tag, attributes in page.tags:
        for name, value in attributes.items():
            assert not name.startswith("on"), f"{tag} has a handler {name}"
            if name in ("src", "href"):
                assert value.startswith("#") or value == "data:,", value
    style = re.findall(r"<style>(.*?)</style>", text, flags=re.DOTALL)
    assert len(style) == 1
    assert not re.search(r"url\(|@import|https?:", style[0])


def test_a_hostile_name_is_shown_and_does_nothing(failing):
    text = report_html(failing.verdict, failing.findings, failing.trials, title="</title><script>1</script>")
    assert "<script" not in text
    page = Page(text)
    assert "<script>alert('x')</script>" in page.text
    hostile = [value for _, a in page.tags for value in a.values() if value and "alert('x')" in value]
    assert hostile, "the name also stands in attributes, where quotes must be escaped"


def test_every_hostile_text_of_a_verdict_is_escaped(failing):
    poison = '"><img src=x onerror=alert(1)>'
    gates = tuple(
        replace(g, message=poison, component=poison, id=f"{poison}{i}")
        for i, g in enumerate(failing.verdict.gates)
    )
    findings = [
        replace(f, claim=poison, null=poison, caveats=(poison,), id=f"{f.id}{poison}")
        for f in failing.findings
    ]
    verdict = replace(
        failing.verdict, gates=gates, provenance={poison: {poison: [poison, poison + "\n" + poison]}}
    )
    text = report_html(verdict, findings, failing.trials, title=poison)
    assert "<img" not in text
    assert Page(text).astray == []


def test_provenance_shows_lists_on_a_line_and_tables_by_row(passing):
    provenance = {
        "shape": [102, 4096],
        "matrix": [[1.0, 0.5], [0.25, 2.0]],
        "names": ["<a>", "b"],
        "none": [],
    }
    verdict = replace(passing.verdict, provenance=provenance)
    text = report_html(verdict, passing.findings, passing.trials, title="x")
    shown = Page(text).text.partition("commands, policy")[2]
    for words in ("shape 102, 4096", "matrix 1.0, 0.5 0.25, 2.0", "names <a>, b", "none none"):
        assert words in shown


def test_samples_alone_leave_no_holes(undecided, passing):
    page, whole = page_of(undecided), page_of(passing)
    headings = [a.get("id") for tag, a in page.tags if tag == "section"]
    assert "importance" not in headings
    assert "importance" in [a.get("id") for tag, a in whole.tags if tag == "section"]
    assert {"gates", "not-checked", "ranks", "coverage", "errors", "worst", "provenance"} <= set(headings)
    for unwanted in ("nan", "None", "NaN", "inf "):
        assert unwanted not in re.sub(r"0 NaN or infinite|NaN or infinite", "", page.text).split()


def test_no_section_is_empty_when_there_is_nothing_at_all(passing):
    verdict = replace(passing.verdict, gates=(), not_checked=(), provenance={}, outcome=Outcome.INCONCLUSIVE)
    verdict = replace(verdict, controls=())
    page = Page(report_html(verdict, [], passing.trials, title="x"))
    assert [a["id"] for tag, a in page.tags if tag == "section"] == [
        "pictures",
        "errors",
        "worst",
        "provenance",
    ]


@pytest.fixture(scope="module")
def diagnosed(failing):
    return replace(failing, verdict=with_diagnosis(failing.verdict, failing.trials, seed=5))


def test_causes_and_cures_stand_first_and_without_a_diagnosis_there_are_none(failing, diagnosed):
    before, after = page_of(failing).text, page_of(diagnosed).text
    assert diagnosed.verdict.diagnosis["named"] == "scale"
    assert UNNAMED in before
    assert UNNAMED not in after
    causes = diagnosed.verdict.diagnosis["causes"]
    assert causes
    first_gate = after.index("What was asked, and the answers")
    for each in causes:
        assert after.index(f"If {each['cause']}: {each['cure']}") < first_gate
    assert after.index("before and after the repair") < first_gate


def test_ranks_are_drawn_before_and_after_on_trials_that_chose_nothing(diagnosed, passing):
    panel = before_and_after(diagnosed.verdict, diagnosed.trials)
    assert "1,000 trials that did not choose the repair" in panel.remark
    said = re.search(
        r"from (\S+) to (\S+) of an even share before the repair, from (\S+) to (\S+) after", panel.picture
    )
    low, high, mended_low, mended_high = map(float, said.groups())
    # Posteriors 0.7 times as wide: the outermost of twenty bins hold 2 Phi(-1.645 * 0.7) / 0.1 = 2.5 shares.
    assert 2.1 < high < 2.9
    assert low < 0.85
    assert mended_low > 0.6
    assert mended_high < 1.5
    # The same by hand, on the trials that neither fitted nor chose.
    main = main_trials(diagnosed.trials)
    rows = thirds(main.sizes["trial"], 5)[2]
    below = (main["draws"].values < main["theta_true"].values[:, None]).sum(axis=1)[rows]
    shares = [np.histogram((column + 0.5) / 101, 20, (0, 1))[0] / 50 for column in below.T]
    assert [low, high] in [[round(each.min(), 2), round(each.max(), 2)] for each in shares]


def test_the_parameter_drawn_is_the_one_that_repairs_in_turn_even_out(passing):
    """Posteriors of `b` half as wide: twice a repair of 1.414 mends them, once does not."""
    rng = np.random.default_rng(8)
    x = rng.normal(size=(900, 2))
    draws = x[:, None] + rng.normal(size=(900, 80, 2)) * [1.0, 0.5]
    tree = trials_tree(make_trials(x + rng.normal(size=x.shape), draws, ["a", "b"]))
    step = {"function": "stretched", "about": "median", "by": [1.0, 2**0.5]}
    unevenness = []
    for steps in ([step], [step, step]):
        told = replace(passing.verdict, diagnosis={"repair": steps, "seed": 0, "gap": {}})
        panel = before_and_after(told, tree)
        assert "Ranks of b," in panel.heading
        unevenness.append(float(re.search(r"to (\S+) after it", panel.picture).group(1)))
    assert unevenness[0] > 1.7 > unevenness[1]
    assert before_and_after(passing.verdict, passing.trials) is None


@pytest.mark.parametrize(
    "repair", [[{"function": "of another version"}], [], [{"function": "stretched", "about": "mean"}]]
)
def test_a_repair_that_is_not_known_leaves_no_picture(diagnosed, repair):
    told = diagnosed.verdict.diagnosis | {"repair": repair}
    assert before_and_after(replace(diagnosed.verdict, diagnosis=told), diagnosed.trials) is None


def test_passed_gates_are_folded_and_failed_ones_have_their_picture(failing):
    text = report_html(failing.verdict, failing.findings, failing.trials, title="x")
    shown = text[text.index('<div class="failing">') : text.index("Passed")]
    failed = [gate for gate in failing.verdict.gates if gate.outcome is Outcome.FAIL]
    assert shown.count("<article") == len(failed) > 0
    assert shown.count("<svg viewBox") == 0
    assert shown.count('class="chart"') >= len([gate for gate in failed if np.isfinite(gate.tolerance)])
    passed = text[text.index("Passed") : text.index('id="pictures"')]
    assert passed.count('class="gate PASS"') == sum(g.outcome is Outcome.PASS for g in failing.verdict.gates)
    assert text.count("<details open") + text.count('class="fold" open') <= 1


def test_a_pass_shows_pictures_of_bulk_tails_and_what_was_learned(passing, undecided, make_audit):
    def opened(audit):
        text = report_html(audit.verdict, audit.findings, audit.trials, title="x")
        return re.findall(r'<section id="([\w-]+)">\s*<details class="fold" open>', text)

    assert passing.verdict.outcome is Outcome.PASS
    assert opened(passing) == ["ranks", "tails", "information"]
    assert opened(undecided) == []
    # Nine parameters are too many to be seen at a glance.
    many = make_audit(n=60, names=tuple("abcdefghi"), densities=False)
    assert opened(replace(many, verdict=replace(many.verdict, outcome=Outcome.PASS)))[0] == "tails"


def test_trials_of_the_worst_region_lie_in_it():
    """Posteriors of `a` lie too high where the datum is large: so do the trials that are listed."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=(1500, 1))
    theta = x + rng.normal(size=x.shape)
    draws = x[:, None] + rng.normal(size=(1500, 60, 1))
    draws[x[:, 0] > 0.8] += 1.5
    tree = trials_tree(make_trials(theta, draws, ["a"], x=x))
    findings, _ = run_validators(tree, seed=1, select=["local"])
    table = in_worst_regions(trial_errors(tree), findings)[0]
    assert table.anchor == "region-0"
    assert len(table.rows) == 5
    assert min(x[int(trial), 0] for trial, _, _ in table.rows) > 0.5
    assert all(said.startswith("+") for _, said, _ in table.rows)


def test_checks_that_lack_the_same_share_a_line(undecided):
    lines = by_reason(undecided.verdict)
    assert len(lines) < len(undecided.verdict.not_checked)
    assert sorted(name for _, names in lines for name in names) == sorted(
        item.id for item in undecided.verdict.not_checked
    )


@pytest.fixture(scope="module")
def twelve(make_audit):
    return make_audit(n=600, draws=40, names=tuple(f"p{i}" for i in range(12)), width=0.6)


def test_the_page_is_small(diagnosed, twelve):
    for audit in (diagnosed, twelve):
        assert len(report_html(audit.verdict, audit.findings, audit.trials, title="x")) < 1_000_000


def test_draws_that_are_all_nan_still_give_a_page(make_audit, passing):
    main = main_trials(passing.trials).copy(deep=True)
    main["draws"].values[:] = np.nan
    page = Page(report_html(passing.verdict, passing.findings, trials_tree(main), title="x"))
    assert "Trials to look at first" in page.text  # the importance trials are still known
    assert "Where the errors fall" not in page.text


def test_panels_for_one_to_twelve_parameters(make_audit, twelve):
    for audit, parameters in ((make_audit(n=100, draws=40, names=("p0",)), 1), (twelve, 12)):
        titles = [a.get("id", "") for tag, a in page_of(audit).tags if tag == "title"]
        assert len([name for name in titles if name.startswith("rank-")]) == parameters


def test_a_wide_posterior_with_weights_is_drawn_from_its_weights():
    rng = np.random.default_rng(2)
    theta = rng.normal(size=(200, 1))
    draws = theta[:, None] + rng.normal(size=(200, 50, 1))
    draws[:, :25] += 1000.0
    weight = np.r_[np.zeros(25), np.ones(25)] * np.ones((200, 1))
    from gaugeblock.reports.worst import trial_errors

    errors = trial_errors(trials_tree(make_trials(theta, draws, ["a"], weight=weight)))
    assert errors is not None
    assert np.abs(errors.mean - theta).max() < 1
    assert np.abs(errors.error).max() < 7
