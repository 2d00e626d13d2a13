import json
import shutil
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sbi")

import gaugeblock as gb
from gaugeblock.estimators.npe import load, reference_model_path
from gaugeblock.simulators import build_simulator
from gaugeblock.validate.joint.importance import kish_fraction, log_weights

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "undertrained-model"
SHIPPED = sorted(path.parent for path in reference_model_path().parent.glob("*/model.json"))

STRICT = ("epic-pn-faint", "epic-pn-medium", "epic-pn-bright", "epic-pn-exposures")
"""Those of the strict policy; the others passed the default one."""

# What 60 trials x 300 draws with a fixed seed have to reach: less than the final audits found, as so few may.
WORTH = {
    "epic-pn-faint": 0.91, "epic-pn-medium": 0.87, "epic-pn-bright": 0.74, "nicer-bright": 0.66,
    "epic-pn-exposures": 0.86,
}  # fmt: skip


def simulator_of(name):
    """What a flow that ships was trained on."""
    return build_simulator(
        **json.loads((reference_model_path(name) / "model.json").read_text())["simulator_table"]
    )


@pytest.mark.parametrize("folder", [*SHIPPED, EXAMPLE], ids=lambda folder: folder.name)
def test_the_flows_that_ship_load_and_say_how_they_were_made(folder):
    flow = load(folder)
    assert flow.record["command"].startswith("gaugeblock train examples/train-")
    # Counts, and an exposure where there is one.
    x = np.full((2, *flow.data_shape), 100)
    draws = flow.sample(x, 5, np.random.default_rng(1))
    assert flow.prior.contains(draws).all()


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda folder: folder.name)
def test_they_carry_the_verdict_of_their_final_audits(folder):
    verdict = json.loads((folder / "verdict.json").read_text())
    failed = [gate["id"] for gate in verdict["gates"] if gate["verdict"] == "FAIL"]
    assert failed == []
    assert verdict["verdict"] == "PASS"
    assert verdict["provenance"]["estimator"]["sha256"] == load(folder).record["sha256"]
    if folder.name in STRICT:
        assert verdict["provenance"]["trials"]["number"] == 20_000
        assert verdict["provenance"]["policy"]["tolerance"]["bias"] == 0.05


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda folder: folder.name)
def test_they_are_loaded_without_a_warning_unless_trained_more_often_than_promised(folder, recwarn):
    flow = gb.load(f"shipped:{folder.name}")
    more = " was trained 4 times, 3 had been promised: an audit that it PASSes says less"
    expected = [f"shipped:{folder.name}{more}"] if folder.name == "epic-pn-bright-gain" else []
    assert [str(told.message) for told in recwarn.list] == expected
    assert flow.record["sha256"] == load(folder).record["sha256"]


def test_one_that_fails_says_so_when_it_is_loaded_and_other_verdicts_say_nothing(tmp_path):
    folder = shutil.copytree(reference_model_path("epic-pn-faint"), tmp_path / "flow")
    verdict = json.loads((folder / "verdict.json").read_text())
    verdict["gates"][0]["verdict"] = "FAIL"
    (folder / "verdict.json").write_text(json.dumps(verdict))
    with pytest.warns(UserWarning, match=f"FAILs {verdict['gates'][0]['id']} in .* do not use its") as caught:
        gb.load(folder)
    assert caught[0].filename == __file__
    verdict["provenance"]["estimator"]["sha256"] = "0" * 64
    for text in (json.dumps(verdict), "{}", "no JSON", '{"provenance": {}, "gates": 3}'):
        (folder / "verdict.json").write_text(text)
        gb.load(folder)
    (folder / "verdict.json").unlink()
    gb.load(folder)


@pytest.mark.parametrize("name", WORTH)
def test_most_of_their_draws_are_worth_keeping(name, xray_data):
    # The seed is fixed; with others a flow as good as this one fails once in a thousand.
    simulator, rng = simulator_of(name), np.random.default_rng(12)
    flow = load(f"shipped:{name}", simulator)
    x = simulator.simulate(simulator.prior.sample(60, rng), rng)
    draws, log_q = flow.sample_and_log_prob(x, 300, rng)
    likelihood = simulator.log_likelihood(draws, x[:, None])
    weight = log_weights(log_q, likelihood, simulator.prior.log_prob(draws))
    assert np.median(kish_fraction(weight)) > WORTH[name]


@pytest.mark.parametrize("name", ["epic-pn-medium", "epic-pn-bright"])
def test_a_spectrum_s_draws_do_not_depend_on_those_beside_it(name, xray_data):
    """To 1e-3 in normal scores: other sums are rounded otherwise, and a fit may not make more of it."""
    from gaugeblock.estimators.npe.coordinates import to_scores

    simulator, rng = simulator_of(name), np.random.default_rng(13)
    flow = load(f"shipped:{name}", simulator)
    x = simulator.simulate(simulator.prior.sample(40, rng), rng)
    for k in range(len(x)):
        # The first of a batch meets the same noise as one alone.
        both = [
            to_scores(simulator.prior, flow.sample(rows, 20, np.random.default_rng(k))[0])
            for rows in (x[k : k + 1], np.roll(x, -k, axis=0)[:3])
        ]
        np.testing.assert_allclose(*both, rtol=1e-3, atol=1e-3)
