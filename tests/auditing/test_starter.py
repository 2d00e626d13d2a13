"""A configuration to begin with, to the letter."""

from __future__ import annotations

import tomllib

import pytest

from gaugeblock.auditing.config import TrialsTable
from gaugeblock.auditing.starter import next_command, starter
from gaugeblock.core.errors import InputError
from gaugeblock.validate import read_policy

OWN = f"""# Audit it with: gaugeblock audit gaugeblock.toml --allow-module mine --allow-module theirs

[simulator]
# What the data should look like: a name of gaugeblock's, or module:object of yours, with
# simulate(theta, rng) and a prior. Further keys are its options.
name = "mine:simulate"

[estimator]
# an object of mine, module:object, with sample(x, n, rng).
name = "theirs.deep:draw"

[trials]
number = 4000    # simulated truths; `gaugeblock plan` says what so many can show
draws = 250      # posterior draws of each
seed = {TrialsTable().seed}  # of everything random: choose your own and keep it

[policy]
base = "strict"  # default or strict, or a file of yours

# What may be wrong without a FAIL; as in the base unless you say otherwise.
# [policy.tolerance]
"""


def test_the_whole_of_it() -> None:
    made = starter(kind="own", simulator="mine:simulate", posterior="theirs.deep:draw", policy="strict")
    assert made.startswith(OWN)
    strict = read_policy("strict").tolerance
    lines = [line.removeprefix("# ") for line in made.removeprefix(OWN).splitlines()]
    assert {line.index("  # ") for line in lines} == {
        max(len(line.partition("  #")[0].rstrip()) for line in lines)
    }
    said = tomllib.loads("\n".join(lines))
    assert list(said) == ["bias", "log_width", "coverage", "joint", "local", "ess"]
    assert said == {name: getattr(strict, name) for name in said}
    assert lines[0].endswith("  # half-widths of 68% intervals")


@pytest.mark.parametrize(
    ("kind", "estimator", "command"),
    [
        ("own", {"name": "mine:draw"}, "gaugeblock audit a.toml --allow-module mine"),
        ("npe", {"name": "npe", "path": "mine:draw"}, "gaugeblock audit a.toml"),
        ("stranger", {"name": "stranger", "path": "mine:draw"}, "gaugeblock audit a.toml"),
        ("draws", None, "gaugeblock audit a.toml --trials mine:draw"),
    ],
)
def test_every_kind_of_posterior(kind: str, estimator: object, command: str) -> None:
    table = tomllib.loads(starter(kind=kind, simulator="xray", posterior="mine:draw"))
    assert table.get("estimator") == estimator
    assert set(table) == ({"policy"} if kind == "draws" else {"simulator", "estimator", "trials", "policy"})
    assert next_command("a.toml", kind, "xray", "mine:draw") == command


def test_a_module_is_named_once_and_no_simulator_where_there_is_none() -> None:
    assert next_command("a", "own", "mine.a:s", "mine.b:d") == "gaugeblock audit a --allow-module mine"
    assert next_command("a", "npe", "mine:s", "x:y") == "gaugeblock audit a --allow-module mine"
    assert next_command("a", "draws", "mine:s", "d.nc") == "gaugeblock audit a --trials d.nc"


def test_what_cannot_be() -> None:
    for given, said in (
        ({"kind": "none"}, "init: none is no kind of posterior; there are own, npe, stranger, draws"),
        ({"policy": "lax"}, "init: policy lax is none of default, strict; put your own into the file"),
        ({"posterior": "draw"}, "init: draw is no object of yours; give module:object"),
    ):
        with pytest.raises(InputError) as caught:
            starter(**{"kind": "own", "simulator": "xray", "posterior": "a:b", **given})
        assert str(caught.value) == said
