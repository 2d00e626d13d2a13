"""Train flows of the published network: ``python -m studies.paper.paper_flow [NAME ...]``.

Weights and records go beside this package, checkpoints into the working directory; a training that was cut
off goes on. Some fifteen minutes of one core each.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import torch

from gaugeblock.core.errors import InputError
from studies.paper.paper_flow.shipped import FLOWS
from studies.paper.paper_flow.training import train
from studies.paper.paper_flow.variants import VARIANTS, Variant


def main() -> None:
    """Train what is named, all without names."""
    parser = argparse.ArgumentParser(prog="python -m studies.paper.paper_flow")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(VARIANTS))
    parser.add_argument("--out", type=Path, default=FLOWS, help="folder for weights and records")
    parser.add_argument("--work", type=Path, default=Path("paper-flow-checkpoints"))
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in VARIANTS]
    if unknown:
        raise InputError(f"no variant {unknown[0]!r}; there are {', '.join(VARIANTS)}")
    torch.set_num_threads(1)  # the same bits on any machine of this kind; more threads hardly help
    for group in _groups(options.names or list(VARIANTS)):
        train(group, options.out, work=options.work, progress=_tell)


def _groups(names: list[str]) -> list[dict[str, Variant]]:
    """Variants that are one training but for its cap, together."""
    groups: dict[str, dict[str, Variant]] = {}
    for name in names:
        variant = VARIANTS[name]
        groups.setdefault(str(variant.describe() | {"cap": None}), {})[name] = variant
    return list(groups.values())


def _tell(stage: str, done: int, total: int) -> None:
    sys.stderr.write(f"{stage}: epoch {done} of at most {total}\n")


if __name__ == "__main__":
    try:
        main()
    except InputError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)
