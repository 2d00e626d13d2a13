"""A configuration to begin with: commented, with the defaults of the code, checked before it is written."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from typing import Any

from gaugeblock.auditing.config import AuditConfig, TrialsTable
from gaugeblock.core.errors import InputError
from gaugeblock.validate.policy import SHIPPED, read_policy

KINDS = {
    "own": "an object of mine, module:object, with sample(x, n, rng)",
    "npe": "a model folder that gaugeblock train made",
    "stranger": "somebody's file; it runs in a sandbox and is never loaded here",
    "draws": "draws on disk, from any library: nothing is simulated",
}
"""Where a posterior may be."""

_ABOUT_TRIALS = {
    "number": "simulated truths; `gaugeblock plan` says what so many can show",
    "draws": "posterior draws of each",
    "seed": "of everything random: choose your own and keep it",
}
_ABOUT_TOLERANCE = {
    "bias": "half-widths of 68% intervals",
    "log_width": "natural log of the factor by which intervals are too wide",
    "coverage": "probability by which intervals miss what they claim",
    "joint": "the same of all parameters together",
    "local": "the same in a region that holds a twentieth of the data",
    "ess": "least share of draws that importance weights keep",
}


def starter(*, kind: str, simulator: str, posterior: str, policy: str = "default") -> str:
    """TOML of an audit, with comments.

    `kind` is one of `KINDS`; `simulator` a registered name or ``module:object``; `posterior` is where the
    posterior is: ``module:object``, a folder or a file (of draws, which a configuration does not name).

    Raises
    ------
    InputError
        If the kind is none, or what it names cannot be.

    >>> starter(kind="own", simulator="mine:simulate", posterior="mine:draw").splitlines()[0]
    '# Audit it with: gaugeblock audit gaugeblock.toml --allow-module mine'
    """
    if kind not in KINDS:
        raise InputError(f"init: {kind} is no kind of posterior; there are {', '.join(KINDS)}")
    if policy not in SHIPPED:
        raise InputError(f"init: policy {policy} is none of {', '.join(SHIPPED)}; put your own into the file")
    if kind == "own" and ":" not in posterior:
        raise InputError(f"init: {posterior} is no object of yours; give module:object")
    lines = [f"# Audit it with: {next_command('gaugeblock.toml', kind, simulator, posterior)}", ""]
    if kind != "draws":
        lines += [
            "[simulator]",
            "# What the data should look like: a name of gaugeblock's, or module:object of yours, with",
            "# simulate(theta, rng) and a prior. Further keys are its options.",
            f"name = {_text(simulator)}",
            "",
            "[estimator]",
            f"# {KINDS[kind]}.",
            *_estimator(kind, posterior),
            "",
            "[trials]",
            *_numbers(
                {name: TrialsTable.model_fields[name].default for name in _ABOUT_TRIALS}, _ABOUT_TRIALS
            ),
            "",
        ]
    tolerance = read_policy(policy).tolerance
    lines += [
        "[policy]",
        f"base = {_text(policy)}  # {' or '.join(SHIPPED)}, or a file of yours",
        "",
        "# What may be wrong without a FAIL; as in the base unless you say otherwise.",
        "# [policy.tolerance]",
        *(
            f"# {line}"
            for line in _numbers({n: getattr(tolerance, n) for n in _ABOUT_TOLERANCE}, _ABOUT_TOLERANCE)
        ),
    ]
    text = "\n".join(lines) + "\n"
    AuditConfig.build(tomllib.loads(text), where="init")
    return text


def next_command(path: str, kind: str, simulator: str, posterior: str) -> str:
    """What to type next."""
    named = [simulator] * (kind != "draws") + [posterior] * (kind == "own")
    modules = dict.fromkeys(name.partition(":")[0].partition(".")[0] for name in named if ":" in name)
    draws = f" --trials {posterior}" if kind == "draws" else ""
    return f"gaugeblock audit {path}{draws}" + "".join(f" --allow-module {module}" for module in modules)


def _estimator(kind: str, posterior: str) -> list[str]:
    name = {"own": posterior, "npe": "npe", "stranger": "stranger"}[kind]
    return [f"name = {_text(name)}"] + [f"path = {_text(posterior)}"] * (kind != "own")


def _numbers(values: Mapping[str, Any], about: Mapping[str, str]) -> list[str]:
    width = max(len(f"{name} = {value}") for name, value in values.items())
    return [f"{f'{name} = {value}':<{width}}  # {about[name]}" for name, value in values.items()]


def _text(value: str) -> str:
    """A string of TOML, whose basic strings are JSON's."""
    return json.dumps(value, ensure_ascii=False)
