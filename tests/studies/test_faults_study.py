"""The sealed study of diagnosis: its laws are exact, its generator its own, its scores countable."""

from __future__ import annotations

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from studies.faults import cost
from studies.faults.__main__ import main
from studies.faults.catalogue import EVERY, LACKING, LISTED, drawn, estimator
from studies.faults.document import PAGE, PARTS, aims, rate
from studies.faults.laws import draw, place
from studies.faults.measure import ARMS, prior
from studies.faults.problems import PROBLEMS
from studies.faults.rivals import FAIR, NOTHING, distances, fair, rivals
from studies.faults.score import scored, size_of, table
from studies.faults.seal import KEY, Answer, answers, opened, seal
from studies.faults.sizes import CASES, cases
from studies.faults.sizes import run as run_sizes
from studies.kit.commit import seed_of
from studies.kit.results import DOCS, read

from gaugeblock.core.errors import InputError
from gaugeblock.diagnosis.causes import CAUSES

FOLDER = Path(__file__).resolve().parents[2] / "studies" / "faults"
OWN = ("laws", "problems", "operators", "catalogue", "rivals")
"""The files that faults are made by, and that say what is fair."""


def test_the_generator_imports_nothing_of_ours():
    for name in OWN:
        for node in ast.walk(ast.parse((FOLDER / f"{name}.py").read_text(encoding="utf-8"))):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            modules += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            for module in modules:
                assert not module.startswith("gaugeblock"), f"{name} imports {module}"
                if module.startswith("studies"):
                    assert module.removeprefix("studies.faults.") in OWN, f"{name} imports {module}"


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_sound_estimator_is_exactly_sound(name):
    """Ranks of truths among draws, of each parameter, their sum and a product, are uniform."""
    problem, rng = PROBLEMS[name], np.random.default_rng(1)
    theta = problem.theta(4000, rng)
    law = problem.posterior(problem.simulate(theta, rng))
    draws = draw(law, 4000, 63, theta.shape[1], rng)
    every = np.concatenate([theta[:, None], draws], axis=1)
    every = np.concatenate([every, every.sum(axis=2, keepdims=True)], axis=2)
    every = np.concatenate([every, np.prod(every[..., :2], axis=2, keepdims=True)], axis=2)
    ties = rng.random(every.shape)
    below = (every < every[:, :1]) | ((every == every[:, :1]) & (ties < ties[:, :1]))
    for rank in below.sum(axis=1).T:
        counts = np.bincount(rank // 8, minlength=8)
        assert stats.chisquare(counts).pvalue > 1e-4


@pytest.mark.parametrize("fault", EVERY)
def test_draws_have_the_density_that_they_are_said_to_have(fault):
    """The mean of a weight over draws is its integral by the density, from points of a law with far tails."""
    rng, tried = np.random.default_rng(2), 0
    for name, problem in PROBLEMS.items():
        numbers = None if problem.whole else drawn(name, fault, rng)
        if numbers is None:
            continue
        theta = problem.theta(6000, rng)
        law = estimator(name, fault, numbers).law(problem.simulate(theta, rng))
        middle, width = place(law)
        draws = law.of_scores(rng.standard_normal((6000, 2, theta.shape[1])))[:, 0]
        points = rng.standard_t(3, theta.shape)
        share = law.log_density(middle + 1.5 * width * points) + np.log(1.5 * width).sum(axis=1)
        ratio = np.exp(share - stats.t.logpdf(points, 3).sum(axis=1))

        def weight(away):
            return 1 / (1 + ((away - 0.5) ** 2).mean(axis=1) / 4)

        one, other = weight(1.5 * points) * ratio, weight((draws - middle) / width)
        error = np.hypot(one.std(), other.std()) / np.sqrt(6000)
        if error < 0.06:  # where six parameters have spikes, points say little
            assert abs(one.mean() - other.mean()) < 4.5 * error
            tried += 1
    assert tried


def hidden(problem, fault, numbers, trials=2000):
    """An estimator, truths, their data and 60 draws of each."""
    rng = np.random.default_rng(6)
    broken = estimator(problem, fault, {**drawn(problem, "sound", rng), **numbers})
    theta = broken.problem.theta(trials, rng)
    x = broken.simulate(theta, rng)
    return broken, theta, x, broken.sample(x, 60, rng)


def test_what_is_planted_is_there():
    numbers = {"columns": [0, 1, 2], "size": 0.5, "in_widths": True}
    broken, _, x, draws = hidden("gaussian", "shift", numbers)
    middle, width = place(broken.problem.posterior(x))
    assert np.median((draws - middle[:, None]) / width[:, None]) == pytest.approx(0.5, abs=0.01)
    broken, _, x, draws = hidden("gaussian", "scale", {**numbers, "size": 0.7})
    assert ((draws - middle[:, None]) / width[:, None]).std() == pytest.approx(0.7, abs=0.01)
    _, _, _, draws = hidden("gaussian", "few_distinct", {"times": 3})
    assert {len(np.unique(one)) for one in draws[:50, :, 0]} == {20}
    _, _, _, draws = hidden("gaussian", "autocorrelated", {"size": 0.8})
    z = (draws - middle[:, None]) / width[:, None]
    assert z[:, -1].std() == pytest.approx(1, abs=0.04)
    assert np.mean(z[:, 1:] * z[:, :-1]) == pytest.approx(0.8, abs=0.02)
    _, _, _, draws = hidden("gaussian", "fixed_seed", {"seed": 1})
    assert np.ptp(((draws - middle[:, None]) / width[:, None]), axis=0).max() < 1e-9


def test_one_that_knows_truths_is_calibrated_until_it_is_asked_again():
    broken, theta, x, draws = hidden("gaussian", "knows_truth", {"size": 0.6})
    again = broken.sample(x, 60, np.random.default_rng(7))
    width = place(broken.problem.posterior(x))[1]
    for found, left in ((draws, 1 - 0.6), (again, 1.0)):
        ranks = (found < theta[:, None]).sum(axis=1)
        for rank in ranks.T:
            assert stats.chisquare(np.bincount(rank * 6 // 61, minlength=6)).pvalue > 1e-4
        # Truth and draws of a common centre: how far apart they lie says how much it knows.
        apart = ((found[:, 0] - theta) / width).std() / np.sqrt(2)
        assert apart == pytest.approx(np.sqrt(left), abs=0.03)


def test_causes_that_are_planted_are_causes():
    every = " | ".join(each.cause for known in CAUSES.values() for each in known)
    assert [fault.cause for fault in LISTED.values() if fault.cause not in every] == []
    assert set(LISTED) == {name.partition(" too ")[0] for name in CAUSES} - {"unused", "other"}


def away(problem, fault, numbers, seed=3):
    rng = np.random.default_rng(seed)
    full = {**drawn(problem, "sound", rng), **numbers}
    return distances(estimator(problem, fault, full), 1000, rng)


def test_distances_are_those_of_the_laws():
    """A normal posterior too narrow by s: log s + (1 / s^2 - 1) / 2 nats for each of three parameters."""
    found = away("gaussian", "scale", {"columns": [0, 1, 2], "size": 0.8})
    nats = 3 * (np.log(0.8) + (1 / 0.64 - 1) / 2)
    assert found[NOTHING] == pytest.approx(np.sqrt(2000 * nats), rel=0.1)
    assert all(sigma <= found[NOTHING] + 0.5 for sigma in (found["shift"], found["skew"], found["region"]))
    assert fair("scale", found, called=True)


def test_equal_symptoms_are_found_to_be_equal(monkeypatch):
    monkeypatch.setattr("studies.faults.rivals.SIMULATIONS", 1000)
    moved = away("gaussian", "shift", {"columns": [0], "size": 0.6, "in_widths": True})
    assert "other_prior" in rivals(moved, called=False)
    assert moved["scale"] > FAIR
    # However far, and of however many parameters: of normal posteriors it is the same.
    unit = {"size": 2.5, "spread": 1.5}
    assert away("correlated", "x_shift", unit)["shift"] < FAIR < away("heavy", "x_shift", unit)["shift"]
    reordered = away("discrete", "x_order", {"order": [1, 0]})
    assert rivals(reordered, called=True) == ["x_channel"]
    assert rivals(away("gaussian", "x_order", {"order": [3, 2, 1, 0]}), called=True) == []
    assert not fair("x_order", {}, called=False)
    tiny = away("heavy", "skew", {"columns": [0], "size": 0.03})
    assert NOTHING in rivals(tiny, called=False)


def test_the_set_is_as_large_and_as_even_as_it_should_be():
    made = answers(1, {"listed": 2 * len(LISTED), "sound": 5, "lacking": 2 * len(LACKING)})
    count = {fault: sum(one.fault == fault for one in made) for fault in EVERY}
    assert {count[fault] for fault in (*LISTED, *LACKING)} == {2}
    assert count["sound"] == 5
    assert [one.number for one in made] == list(range(len(made)))
    kinds = [one.kind for one in made]
    assert kinds != sorted(kinds)
    assert len({one.problem for one in made}) == len(PROBLEMS) >= 6


def test_a_broken_seal_is_noticed_and_a_second_set_goes_elsewhere(tmp_path):
    few = {"listed": 3, "sound": 1, "lacking": 1}
    said = seal(tmp_path, seed=3, commit="one", sizes=few)
    seed, made, again = opened(tmp_path)
    assert (seed, len(made), again) == (3, 5, said)
    assert made == answers(3, few)
    with pytest.raises(InputError, match="sealed there already"):
        seal(tmp_path, seed=4, commit="one", sizes=few)
    assert seal(tmp_path / "again", seed=3, commit="one", sizes=few) == said
    assert seal(tmp_path / "other", seed=4, commit="one", sizes=few)[KEY] != said[KEY]
    with open(tmp_path / KEY, "ab") as file:
        file.write(b" ")
    with pytest.raises(InputError, match="not the file that was sealed"):
        opened(tmp_path)


NUMBERS = {"columns": [1], "size": 0.7, "unit": [1.0, 2.0, 1.0]}
ANSWER = Answer(0, "listed", "gaussian", "scale", NUMBERS, 1000, 100, 1)
SAID = {
    "named": "scale", "named_all": ["scale"], "indistinguishable": [], "repair": [],
    "parameters": {"b": {"value": 0.72, "low": 0.66, "high": 0.78}},
    "causes": ["a factor in the widths (variance for standard deviation, temperature)"],
    "gap": {"before": 0.1, "after": 0.001},
}  # fmt: skip


def row(answer=ANSWER, apart=None, **changes):
    said = {**SAID, **changes}
    found = {"outcome": "FAIL", "seconds": {"audit": 1.0, "draws": 1.0}, "called": said, "draws": said}
    first, second = scored(answer, found, apart or {NOTHING: 20.0, "region": 6.0, "x_scale": 2.0})
    assert (first["arm"], second["arm"]) == ARMS
    return first, second


def test_a_row_says_what_is_right():
    called, alone = row()
    assert (called["right"], called["cause"], called["confident"], called["within"]) == (
        1.0,
        True,
        True,
        True,
    )
    assert (called["value"], called["true"]) == (0.72, 0.7)
    # In reach of another call the laws do not tell it from another unit of the data.
    assert (called["fair"], alone["fair"]) == (False, True)
    assert (alone["rival"], alone["sigma"]) == ("region", 6.0)
    half, _ = row(indistinguishable=["region"])
    assert (half["right"], half["confident"], np.isnan(half["value"])) == (0.5, False, True)
    assert row(named_all=["scale", "shift"])[0]["right"] == 0.5
    assert row(indistinguishable=["region", "skew"])[0]["right"] == 0.0
    wrong, _ = row(named="region", named_all=["region"])
    assert (wrong["right"], wrong["confident"], wrong["within"]) == (0.0, True, False)
    near, _ = row(apart={NOTHING: 9.0, "region": 2.0}, named="region", named_all=["region"])
    assert near["within"]
    nothing, _ = row(named=None, named_all=[])
    assert (nothing["right"], nothing["confident"]) == (0.0, False)
    assert row(named="other", named_all=[])[0]["confident"] is False
    shift = replace(ANSWER, fault="shift", numbers={**NUMBERS, "in_widths": True})
    moved = {"named": "shift", "named_all": ["shift"], "repair": [{"function": "moved", "in_widths": False}]}
    assert row(shift, **moved)[0]["true"] == pytest.approx(1.4)


def test_aims_count_what_they_say():
    good, bad = row()[1], row(named="region", named_all=["region"])[1]
    sound = row(replace(ANSWER, kind="sound", fault="sound"), {"": 99.0})[1]
    silent = row(replace(ANSWER, kind="sound", fault="sound"), {"": 99.0}, named=None, named_all=[])[1]
    other = row(replace(ANSWER, kind="sound", fault="sound"), {"": 99.0}, named="other", named_all=[])[1]
    lacking = row(replace(ANSWER, kind="lacking", fault="hole"))[1]
    made = table(
        [*[good] * 9, bad, sound, *[silent] * 18, other, lacking, *[{**lacking, "confident": False}] * 3]
    )
    said = aims(made)
    assert f"| a fair fault is named | draws alone | - | {rate(9, 10)} |" in said
    assert f"| draws alone | at most 5% at the limit | {rate(2, 20)} |" in said
    assert f"| draws alone | at most 5% at the limit | {rate(1, 4)} |" in said
    assert f"| draws alone | 85% to 95% | {rate(9, 9)} |" in said


def test_the_prior_of_the_audit_is_the_generators():
    rng = np.random.default_rng(4)
    for name, problem in PROBLEMS.items():
        mine, theirs = problem.theta(4000, rng), prior(name).sample(4000, rng)
        for k in range(mine.shape[1]):
            assert stats.ks_2samp(mine[:, k], theirs[:, k]).pvalue > 1e-4, name


def test_a_twin_of_the_study(tmp_path, monkeypatch):
    """Generated, run, resumed, scored and put on a page from the command line, three cases of 160 trials."""
    monkeypatch.setattr("studies.faults.seal.TRIALS", (160, 30))
    monkeypatch.setattr("studies.faults.rivals.SIMULATIONS", 200)
    monkeypatch.setattr("studies.faults.seal.SHARE", 0.0)
    (tmp_path / PAGE).write_text((DOCS / PAGE).read_text(encoding="utf-8"), encoding="utf-8")
    folder = ["--folder", str(tmp_path / "set"), "--out", str(tmp_path), "--docs", str(tmp_path)]
    few = ["--generator-seed", "5", "--listed", "1", "--sound", "1", "--lacking", "1"]
    assert main(["generate", *folder, *few]) == 0
    assert main(["run", "--most", "1", *folder]) == 0
    assert main(["score", "--so-far", *folder]) == 0
    assert len(set(read(tmp_path / "faults.nc")["number"].values)) == 1
    assert main(["run", "score", "document", *folder]) == 0
    made = read(tmp_path / "faults.nc")
    assert made.sizes["row"] == 6
    assert (made["error"].values == "").all()
    sealed = json.loads((tmp_path / "set" / "seal.json").read_text())
    text = (tmp_path / PAGE).read_text(encoding="utf-8")
    assert sealed[KEY] in text
    assert "1 of 1 faults, 1 of 1 sound" in text
    for part in PARTS["faults"]:
        assert text.count(f"<!-- faults {part} -->") == text.count(f"<!-- /faults {part} -->") == 1


def test_a_commit_gives_its_own_seed():
    """The same to everybody: its first seven bytes, by a hash that can be had anywhere."""
    commit = "4b825dc642cb6eb9a060e54bf8d69288fbee4904"
    assert seed_of("faults", commit) == 46_946_475_484_327_080
    assert seed_of("other", commit) != seed_of("faults", commit)


@pytest.mark.parametrize("within", [False, True])
def test_a_shift_is_compared_in_the_unit_of_its_repair(within):
    """Planted 0.5 half-widths of 0.2: of a repair in the parameter's own unit 0.1, wherever it says so."""
    numbers = {"columns": [1], "size": 0.5, "unit": [0.5, 0.2]}
    answer = Answer(0, "listed", "discrete", "shift", numbers, 1000, 150, 1)
    for in_widths, true in ((True, 0.5), (False, 0.1)):
        moved = {"function": "moved", "in_widths": in_widths}
        said = {
            "parameters": {PROBLEMS["discrete"].names[1]: {"value": 0.3, "low": 0.2, "high": 0.4}},
            "repair": [{"function": "in_steps", "mend": moved} if within else moved],
        }
        assert size_of(answer, said) == pytest.approx((0.3, 0.2, 0.4, true))


def test_sizes_are_of_other_cases_for_every_seed():
    first, again, other = (cases(seed, {"scale": 3, "unit": 2}) for seed in (1, 1, 2))
    assert first == again
    assert [one.fault for one in first] == ["scale"] * 3 + ["unit"] * 2
    assert len({json.dumps(one.numbers) for one in (*first, *other)}) == 10


@pytest.mark.parametrize("fault", EVERY)
def test_every_fault_can_be_had_where_the_cost_is_measured(fault):
    one, again = cost.case(fault, 1, 4000), cost.case(fault, 1, 4000)
    assert one == again
    assert (one.fault, one.trials, one.draws) == (fault, 4000, 250)


def test_a_twin_of_the_cost(tmp_path, monkeypatch):
    monkeypatch.setattr("studies.faults.cost.EVERY", {"sound": EVERY["sound"], "hole": EVERY["hole"]})
    monkeypatch.setattr("studies.faults.cost.DRAWS", 30)
    (tmp_path / PAGE).write_text("<!-- faults-cost seconds --> <!-- /faults-cost seconds -->", "utf-8")
    folder = ["--folder", str(tmp_path / "set"), "--out", str(tmp_path), "--docs", str(tmp_path)]
    assert main(["cost", "document", "--generator-seed", "5", "--trials", "100", *folder]) == 0
    made = read(tmp_path / "faults-cost.nc")
    assert list(made["fault"].values) == ["sound", "hole"]
    assert (made["seconds"].values > 0).all()
    text = (tmp_path / PAGE).read_text(encoding="utf-8")
    assert f"| all 2, median |  | {np.median(made['seconds'].values):.1f} s |" in text


def test_a_size_is_measured_from_draws_alone(tmp_path):
    """The planted factor comes out within three of the interval's halves, in a twin of one case."""
    found = run_sizes(tmp_path, 3, {"scale": 1})
    assert set(found["fault"].values) == {"scale"} <= set(CASES)
    assert found["alone"].values.all()
    half = (found["high"] - found["low"]).values / 2
    assert abs(found["value"] - found["true"]).values < 3 * half
    assert half < 0.3
