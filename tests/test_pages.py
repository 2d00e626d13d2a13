"""Every how-to page runs, block after block, in one process, and ends as it says."""

from __future__ import annotations

import importlib.util
import re
import shutil
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = ROOT / "docs" / "how-to"
BLOCK = re.compile(
    r"^(?:<!-- (file|runs where there is): (\S+) -->\n)?( *)```(python|sh)\n(.*?)^\3```", re.M | re.S
)
CODES = {"PASS": 0, "FAIL": 1, "INCONCLUSIVE": 3}
# What the page says of what its blocks leave behind.
SAID = {
    "bayesflow": "result.trials.sizes['draw'] == 100 and result.outcome != 'PASS' and "
    "list(result.trials['parameter'].values) == ['rate', 'slopes[0]', 'slopes[1]']",
    "bxa": "result.trials.sizes['draw'] == 200 and result.outcome != 'FAIL'",
    "cluster": "Path('run/verdict.json').exists()",
    "dynesty": "result.trials.sizes['trial'] == 10 and result.outcome != 'FAIL'",
    "effect": "found.named == 'saturation' and "
    "found.amplitude[0].interval[0] < 0.6 < found.amplitude[0].interval[1]",
    "emcee": "result.trials.sizes['draw'] == 960 and result.outcome == 'INCONCLUSIVE'",
    "estimator": "Path('gaugeblock-audit/verdict.json').exists()",
    "fault": "abs(mended.draws.mean()) < 0.05 and len(lost_sign(mended)) == 0",
    "gate": "Path('model.py').exists()",
    "ltu-ili": "result.trials.sizes['draw'] == 60 and result.outcome != 'FAIL' and callable(draw)",
    "mend": "'x is not scaled: its standard deviations are 1.09e+06 to 1.53e+06: standardise x' in "
    "' '.join(printed.split())",
    "mlflow": "passed.outcome == 'PASS' and failed.outcome == 'FAIL' and client.get_model_version_by_alias("
    "'rate', 'deployed').run_id == sound and client.get_run(narrow).data.tags['gaugeblock.outcome'] == 'FAIL'"
    " and client.get_run(sound).data.metrics['sbc.bias/rate'] == passed['sbc.bias[rate]'].statistic"
    " and client.list_artifacts(sound, 'audit')",
    "models": "result.outcome == 'PASS' and blocked.outcome == 'FAIL' and 'too flat' in "
    "blocked.verdict.diagnosis['text'] and '0.851 of 2,000' in blocked['models.reliability[wide]'].message",
    "nautilus": "result.trials.sizes['draw'] == 200 and result.outcome != 'FAIL'",
    "numpyro": "result.trials.sizes['draw'] == 200 and {*result.trials['parameter'].values} == {'mu', 'tau'}",
    "one-observation": "answer.outcome == 'FAIL' and answer.p_value == 0.001",
    "pymc": "result.trials.sizes['draw'] == 200 and result.outcome != 'FAIL'",
    "read-a-fail": "result.outcome == 'FAIL' and 'narrow' in cause.text",
    "simulator": "simulate(prior.sample(3, rng := np.random.default_rng(1)), rng).shape == (3, 2)",
    "stan": "result.trials.sizes['draw'] == 100 and result.outcome != 'FAIL'",
    "stranger": "True",
    "tolerance": "result.outcome == 'FAIL' and gb.judge(result, lenient).outcome == 'PASS'"
    " and 3000 < of_default < 3600 and of_twice < of_default / 2 and seen['bias'] > 0.2",
    "ultranest": "result.trials.sizes['draw'] == 200 and result.outcome != 'FAIL'",
    "validator": "finding.estimate.shape == (2,) and abs(finding.estimate).max() < 0.1",
}  # fmt: skip
# What compiles for a minute runs in an environment that has the time: `pages`.
SLOW = ("numpyro",)
# What a page needs from its first block on, and whose warnings are its own affair.
TRAINED_BY = {"bayesflow": "bayesflow", "mend": "sbi"}


def test_every_page_says_how_it_ends():
    assert {page.stem for page in PAGES.glob("*.md")} == set(SAID)


@pytest.mark.parametrize("name", sorted(SAID))
def test_a_page_is_short(name):
    assert len((PAGES / f"{name}.md").read_text(encoding="utf-8").splitlines()) < 40


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=[pytest.mark.slow] * (name in SLOW)
            + [pytest.mark.filterwarnings("ignore")] * (name in TRAINED_BY),
        )
        for name in sorted(SAID)
    ],
)
def test_a_page_runs_and_ends_as_it_says(name, tmp_path, monkeypatch, runner):
    if importlib.util.find_spec(TRAINED_BY.get(name, "numpy")) is None:
        pytest.skip(f"needs {TRAINED_BY[name]}")
    shutil.copytree(ROOT / "examples" / "outputs", tmp_path / "outputs")
    monkeypatch.chdir(tmp_path)
    runner.command("pytest", 'exec python -m pytest -q -p no:cacheprovider "$@"')
    names: dict[str, object] = {"Path": Path, "printed": ""}
    for mark, what, _, language, code in BLOCK.findall((PAGES / f"{name}.md").read_text(encoding="utf-8")):
        if mark == "runs where there is" and importlib.util.find_spec(what) is None:
            if name == what != "pymc":  # nothing of the page is left; of pymc there is, with what it wrote
                pytest.skip(f"needs {what}")
            continue
        code = textwrap.dedent(code)
        if mark == "file":
            Path(what).write_text(code, encoding="utf-8")
        elif language == "python":
            exec(compile(code, f"{name}.md", "exec"), names)
        elif said := re.search(r"^# ([A-Z]+)$", code, re.M):
            done = runner.run(code, tmp_path, {})
            assert done.code == CODES[said[1]], done.stdout + done.stderr
            names["printed"] = f"{names['printed']}{done.stdout}"
    assert eval(SAID[name], names), {
        key: names.get(key) for key in ("result", "answer", "found", "finding", "cause")
    }
