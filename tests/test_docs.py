"""What is measured is described, and what is described is measured."""

import ast
import importlib
import re
import shlex
import textwrap
import threading
from fnmatch import fnmatch
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
import typer

from gaugeblock.validate import VALIDATORS, make_trials, run_validators, trials_tree

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def said():
    """Ids without their brackets, of everything that a full set of trials lets the default validators say."""
    rng = np.random.default_rng(1)
    theta = rng.normal(size=(400, 2))
    x = theta + rng.normal(size=theta.shape)
    draws = x[:, None] / 2 + np.sqrt(0.5) * rng.normal(size=(400, 60, 2))

    def normal(value, sd):
        return (-0.5 * (value / sd) ** 2 - np.log(sd) - 0.5 * np.log(2 * np.pi)).sum(axis=-1)

    full = make_trials(
        theta, draws, ["a", "b"], x=x,
        log_q=normal(draws - x[:, None] / 2, np.sqrt(0.5)), log_q_true=normal(theta - x / 2, np.sqrt(0.5)),
        log_likelihood=normal(draws - x[:, None], 1.0), log_likelihood_true=normal(theta - x, 1.0),
        log_prior=normal(draws, 1.0),
    )  # fmt: skip
    full["quantity_first"] = full["draws"].isel(parameter=0, drop=True)
    full["quantity_first_true"] = full["theta_true"].isel(parameter=0, drop=True)
    findings, not_checked = run_validators(trials_tree(full), seed=1)
    return {item.id.partition("[")[0] for item in (*findings, *not_checked)}


def test_every_finding_is_described(said):
    text = (ROOT / "docs" / "validators.md").read_text(encoding="utf-8")
    named = re.findall(r"`([a-z0-9_]+\.[a-z_*]+)(?:\[\w+\])?`", text)
    missing = {item for item in said if not any(fnmatch(item, pattern) for pattern in named)}
    assert not missing


def test_every_validator_has_its_word(said):
    assert {name for name, validator in VALIDATORS.items() if validator.by_default} == {
        item.partition(".")[0] for item in said
    }


@pytest.mark.parametrize("needs", ["", "torch"])
def test_the_page_on_priors_runs(needs):
    """Its blocks, one after the other; those marked torch after all others, where torch and sbi are."""
    text = (ROOT / "docs" / "priors.md").read_text(encoding="utf-8")
    names = {}
    marked = r"(<!-- where there is torch -->\n)?```python\n(.*?)```"
    for kind, block in re.findall(marked, text, flags=re.DOTALL):
        if kind:
            pytest.importorskip("sbi") if needs else None
        if not kind or needs:
            exec(compile(block, "docs/priors.md", "exec"), names)


def test_the_page_on_priors_names_every_distribution():
    from gaugeblock.simulators.prior import DISTRIBUTIONS

    text = (ROOT / "docs" / "priors.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in text for name in DISTRIBUTIONS if name != "scipy")


def test_the_page_on_results_runs():
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(compile(block, "docs/results.md", "exec"), {})


def commands(text):
    """Command lines of `gaugeblock` in fenced blocks, continued lines joined, comments and prompts gone."""
    for block in re.findall(r"^```\w*[^\n]*\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE):
        for line in block.replace("\\\n", " ").splitlines():
            if match := re.match(r"(?:\$ |- run: )?(gaugeblock [a-z-].*)", line.strip()):
                yield match[1]


PROSE = [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md", *(ROOT / "examples").rglob("*.md")]


@pytest.mark.parametrize("page", PROSE, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_command_on_a_page_has_the_options_it_is_given(page):
    from gaugeblock.cli import app

    main = typer.main.get_command(app)
    for line in commands(page.read_text(encoding="utf-8")):
        _, *words = shlex.split(line, comments=True)
        command = main
        while hasattr(command, "commands") and words:
            assert words[0] in command.commands, line
            command = command.commands[words.pop(0)]
        command.make_parser(command.make_context("gaugeblock", [], resilient_parsing=True)).parse_args(words)


@pytest.mark.parametrize("page", PROSE, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_row_of_a_table_has_as_many_cells_as_its_head(page):
    """What is beyond the head's is not shown, and what is lacking is empty."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for lines in re.findall(r"(?:^\|.*\n)+", text, flags=re.MULTILINE):
        cells = {line: len(re.findall(r"(?<!\\)\|", line)) for line in lines.splitlines()}
        assert set(cells.values()) == {next(iter(cells.values()))}, cells


@pytest.mark.parametrize("page", PROSE, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_what_a_page_takes_from_the_package_is_there(page):
    """Also in blocks that no test runs: they are Python, and their imports and every `gb.name` exist."""
    import gaugeblock
    from gaugeblock.core.errors import MissingExtraError

    text = page.read_text(encoding="utf-8")
    for block in re.findall(r"^ *```python[^\n]*\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL):
        for node in ast.walk(ast.parse(textwrap.dedent(block))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gaugeblock"):
                try:
                    module = importlib.import_module(node.module)
                    missing = [one.name for one in node.names if not hasattr(module, one.name)]
                except MissingExtraError:
                    continue
                assert not missing, block
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                assert node.value.id != "gb" or node.attr in dir(gaugeblock), block


@pytest.fixture
def makers(monkeypatch):
    """What makes pages can be imported."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "_site"))


@pytest.mark.usefixtures("makers")
def test_the_site_shows_every_public_name_key_and_option():
    from reference import command_line, configuration, python

    import gaugeblock

    assert len(re.findall("^::: ", python(), flags=re.MULTILINE)) == len(dir(gaugeblock))
    said = command_line()
    assert "## gaugeblock audit" in said
    assert "`--estimator-python" in said
    keys = configuration()
    assert all(f"`{key}`" in keys for key in ("joint_number", "log_width", "error_budget", "kind"))


def test_the_page_on_likelihoods_runs_and_names_every_bug(same_likelihood):
    text = (ROOT / "docs" / "likelihoods.md").read_text(encoding="utf-8")
    names = {}
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(compile(block, "docs/likelihoods.md", "exec"), names)
    names["test_likelihood"](same_likelihood)
    room = ROOT / "validate" / "likelihood"
    source = "".join((room / f"{name}.py").read_text() for name in ("explain", "changes", "terms", "density"))
    named = set(re.findall(r'(?:Explanation|Change|Term|return)\(?\s*"([a-z0-9 ]+)",', source))
    assert len(named) > 15
    assert not {name for name in named if f"`{name}`" not in text}


@pytest.mark.usefixtures("makers")
def test_the_page_on_faults_shows_what_audits_say():
    """One row, made again; the pictures are of the same audits."""
    import faults

    text = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
    assert faults.table({"shifted": faults.row(faults.audited("shifted"))}).splitlines()[-1] in text
    for name in faults.FAULTS:
        assert f"(figures/fault-{name}.svg)" in text
        assert f"\n| {name.replace('_', ' ')} | " in text
        assert (ROOT / "docs" / "figures" / f"fault-{name}.svg").stat().st_size < 10_000
    picture = (ROOT / "docs" / "figures" / "diagnosis-mended.svg").read_text(encoding="utf-8")
    assert all(f">{name}</text>" in picture for name in faults.MENDED)


@pytest.mark.usefixtures("makers")
def test_links_that_lead_nowhere_are_said(tmp_path):
    import links

    (tmp_path / "there.txt").write_text("here")
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        at = f"http://127.0.0.1:{server.server_address[1]}"
        page = tmp_path / "page.md"
        page.write_text(f"[a]({at}/there.txt#part), [b]({at}/gone) and <{at}/there.txt>; [c](own.md)")
        found = links.links([page])
        assert found == {f"{at}/there.txt": ["page.md"], f"{at}/gone": ["page.md"]}
        assert links.report(found).splitlines() == [
            f"{at}/gone: 404 File not found (in page.md)",
            "2 links, 1 of them lead nowhere",
        ]
        server.shutdown()
    assert "2 links, none checked" in links.report(found)
