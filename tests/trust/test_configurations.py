"""Configurations run only what was asked for, and trust is given on the command line alone."""

from __future__ import annotations

import html
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.auditing.audit import audit, audit_configured
from gaugeblock.auditing.config import AuditConfig, read_config
from gaugeblock.auditing.estimator_from import as_estimator
from gaugeblock.auditing.trusted import DENSITIES, NO_SANDBOX, SEED, trust_of, trust_record
from gaugeblock.core.errors import InputError
from gaugeblock.core.trust import Trust, modules_in, only_named
from gaugeblock.estimators import build_estimator
from gaugeblock.estimators.protocol import layers, untrusted
from gaugeblock.reports.summary import summary_markdown
from gaugeblock.simulators import build_simulator
from gaugeblock.simulators.registry import load_object

MODULE = """
import subprocess
from gaugeblock.simulators import build_simulator
open("imported", "w").close()
simulator = build_simulator("linear_gaussian", parameters=2, data=3)

def own(**options):
    return simulator
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A working directory with a module of somebody's."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "theirs_to_name.py").write_text(MODULE)
    yield tmp_path
    sys.modules.pop("theirs_to_name", None)


def configured(place: Path, toml: str, **given: Any) -> AuditConfig:
    (place / "audit.toml").write_text(toml)
    return read_config(place / "audit.toml", **given)


def run(config: AuditConfig) -> None:
    audit_configured(config, progress=False)


@pytest.mark.attack('a configuration with simulator.name = "subprocess:run"', "refused, not called, exit 2")
@pytest.mark.parametrize("table", ["simulator", "estimator"])
@pytest.mark.parametrize("name", ["subprocess:run", "os:system", "builtins:exec"])
def test_pythons_own_callables(place: Path, table: str, name: str) -> None:
    toml = f'[{table}]\nname = "{name}"\nargs = ["touch", "ran"]\n'
    toml += "" if table == "simulator" else '[simulator]\nname = "linear_gaussian"\n'
    for allowed in ((), (name.partition(":")[0],)):
        with pytest.raises(InputError, match="is Python's own"):
            run(configured(place, toml, allow_modules=allowed))
    assert not (place / "ran").exists()


@pytest.mark.attack("a configuration that names a module in the working directory", "not imported, exit 2")
@pytest.mark.parametrize(
    "toml",
    [
        '[simulator]\nname = "theirs_to_name:simulator"\n',
        '[simulator]\nname = "linear_gaussian"\nprior = "theirs_to_name:prior"\n',
        '[simulator]\nname = "linear_gaussian"\n[estimator]\nname = "theirs_to_name:own"\n',
        '[simulator]\nname = "linear_gaussian"\n[estimator]\nname = "importance_refined"\n'
        'base = { name = "conformal", seed = 1, base = { name = "theirs_to_name:own" } }\n',
        '[simulator]\nname = "linear_gaussian"\n[estimator]\nname = "broken"\nfault = "narrow"\n'
        'base = "theirs_to_name:own"\n',
    ],
)
def test_a_module_that_a_file_names(place: Path, toml: str) -> None:
    with pytest.raises(InputError, match="say so yourself: --allow-module theirs_to_name"):
        run(configured(place, toml))
    assert not (place / "imported").exists()


def test_what_was_typed_loads(place: Path) -> None:
    name = "theirs_to_name:own"
    for given in ({"allow_modules": ["theirs_to_name"]}, {"settings": {"simulator.name": name}}):
        config = configured(place, f'[simulator]\nname = "{name}"\n', **given)
        assert config.modules == {"theirs_to_name"}
        with only_named(config.modules):
            assert load_object(name, "simulator")() is not None
    with pytest.raises(InputError, match="allow-module"), only_named({"theirs", "name"}):
        load_object(name, "simulator")
    # Python and a command line without a file: whoever typed a name meant it.
    assert read_config(None, settings={"simulator.name": name}).modules is None
    assert load_object(name, "simulator")() is not None


@pytest.mark.attack("Python's own callable through a module that was allowed", "refused, not called, exit 2")
def test_pythons_own_through_another_module(place: Path) -> None:
    for path in ("subprocess.run", "subprocess", "subprocess.os.system"):
        with pytest.raises(InputError, match="is Python's own"):
            load_object(f"theirs_to_name:{path}", "simulator")


def test_a_package_declares_its_own(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    declared = metadata.EntryPoint("theirs", "theirs_to_name:own", "gaugeblock.simulators")
    monkeypatch.setattr(metadata, "entry_points", lambda group: [declared] if group == declared.group else [])
    with only_named(()):
        assert load_object("theirs_to_name:own", "simulator")() is not None
        with pytest.raises(InputError, match="allow-module"):
            load_object("theirs_to_name:simulator", "simulator")
        with pytest.raises(InputError, match="allow-module"):
            load_object("theirs_to_name:own", "estimator")


@pytest.mark.attack("a training configuration that names a module or os:system", "not imported, exit 2")
def test_a_training_configuration(place: Path) -> None:
    pytest.importorskip("sbi")
    from gaugeblock.estimators.npe import run_training

    for name, words in (("theirs_to_name:own", "allow-module"), ("os:system", "Python's own")):
        (place / "train.toml").write_text(
            f'output = "m"\n[simulator]\nname = "{name}"\ncommand = "touch ran"'
        )
        with pytest.raises(InputError, match=words):
            run_training(place / "train.toml")
    assert not (place / "imported").exists()
    assert not (place / "ran").exists()


@pytest.mark.attack("trust = true in a configuration, in a base of a base", "refused, exit 2")
@pytest.mark.parametrize(
    "toml",
    [
        '[estimator]\nname = "stranger"\npath = "x"\ntrust = true\n',
        '[estimator]\nname = "conformal"\nseed = 1\nbase = {name = "stranger", path = "x", trust = true}\n',
        '[estimator]\nname = "a"\nbase = {name = "b", base = {name = "stranger", trust = false}}\n',
        "[policy]\ntrust = true\n",
    ],
)
def test_trust_in_a_file(place: Path, toml: str) -> None:
    with pytest.raises(InputError, match=r"audit\.toml: [a-z.]+\.trust cannot be said by a file"):
        configured(place, toml)


def test_modules_are_found_in_what_was_typed() -> None:
    typed = {"a": "one.two:x", "b": {"c": ["three:y", 4]}, "d": "C:/path", "e": "shipped:epic-pn", "f": "x"}
    assert modules_in(typed) == {"one.two", "three"}


THEIRS = """
import numpy as np
def sample(x, n, seed):
    return np.random.default_rng(seed).standard_normal((len(x), n, 2))
"""
WRAPPED = {
    "conformal": {"seed": 1, "number": 40, "draws": 40},
    "broken": {"fault": "narrow"},
    "rearranged": {},
}


@pytest.mark.attack(
    "a stranger as the base of another estimator", "sandbox, fresh seed and record as without"
)
@pytest.mark.parametrize("wrapper", sorted(WRAPPED))
def test_wrappers_are_trusted_as_far_as_their_base(sandbox: Any, place: Path, wrapper: str) -> None:
    (place / "stranger.py").write_text(THEIRS)
    simulator = build_simulator("linear_gaussian", parameters=2, data=3)
    base = {"name": "stranger", "path": str(place / "stranger.py")}
    made = (
        as_estimator({"name": wrapper, "base": base, **WRAPPED[wrapper]}, simulator)
        if (wrapper != "rearranged")
        else None
    )
    if made is None:
        from gaugeblock.auditing.estimator_from import RearrangedEstimator
        from gaugeblock.stranger.mapping import Mapping

        made = RearrangedEstimator(build_estimator(**base, simulator=simulator), Mapping.of(None, ("a", "b")))
    try:
        assert untrusted(made)
        assert trust_of(made) is Trust.CONFINED
        assert trust_record(simulator, made, seed_given=True) == {
            "simulator": "shipped", "estimator": "confined", "caveats": [SEED]
        }  # fmt: skip
        assert [type(layer).__name__ for layer in layers(made)][-1] == "Stranger"
    finally:
        layers(made)[-1].close()  # type: ignore[attr-defined]


def test_a_wrapped_stranger_is_audited_as_one(sandbox: Any, place: Path) -> None:
    (place / "stranger.py").write_text(THEIRS)
    base = {"name": "stranger", "path": str(place / "stranger.py")}
    result = audit(
        {"name": "broken", "fault": "narrow", "base": base},
        {"name": "linear_gaussian", "parameters": 2, "data": 3},
        trials={"number": 20, "draws": 20, "importance_number": 0, "joint_number": 0},
        validators=["draws"],
        progress=False,
    )
    record = result.verdict.provenance
    assert record["seed"] != 20260611
    assert record["trust"] == {"simulator": "shipped", "estimator": "confined", "caveats": []}
    assert record["confinement"]["sandbox"]["program"].startswith("bubblewrap")
    assert record["listing"] is not None


class Own:
    """What a user gives as an object."""

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        return rng.standard_normal((len(x), n, 2))


class Loose:
    """An estimator that nobody vouches for, with a density, in this process."""

    untrusted = True

    def confinement(self) -> dict[str, Any]:
        return {"sandbox": "none: trusted by whoever ran the audit"}

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        return rng.standard_normal((len(x), n, 2))

    def log_prob(self, theta: Any, x: Any) -> Any:
        return -0.5 * (np.asarray(theta) ** 2).sum(axis=-1)


@pytest.mark.attack(
    "the seed given for a stranger; trust given; densities that nothing checks",
    "a caveat in verdict, summary and report",
)
def test_what_lowers_trust_is_said_everywhere(tmp_path: Path) -> None:
    result = audit(
        Loose(),
        {"name": "linear_gaussian", "parameters": 2, "data": 3},
        trials={"number": 20, "draws": 20, "importance_number": 0, "joint_number": 0},
        seed=3,
        validators=["draws"],
        progress=False,
        out=tmp_path / "out",
    )
    caveats = result.verdict.provenance["trust"]["caveats"]
    assert caveats == [NO_SANDBOX, SEED, DENSITIES]
    summary = summary_markdown(result.verdict, title="t")
    page = html.unescape((tmp_path / "out" / "report.html").read_text())
    for said in caveats:
        assert said[:40] in summary
        assert said[:40] in page
    assert trust_of(Own()) is Trust.NAMED
    assert trust_of(build_estimator("exact", build_simulator("linear_gaussian"))) is Trust.SHIPPED
