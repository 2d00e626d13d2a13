"""Does a wrongly trained flow PASS once it is trained again as its diagnosis says, and not without?"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from gaugeblock.core.progress import Bars
from studies.cures.document import document
from studies.cures.measure import run, table
from studies.kit.command import carried_out, given, of_a_commit, seeded
from studies.kit.results import write

NAME = "studies cures"


def main(arguments: Sequence[str]) -> int:
    """Train, diagnose and train again; or fill the page from what is stored."""
    options = of_a_commit(NAME, __doc__)
    options.add_argument("--cases", type=int, default=120)
    chosen = options.parse_args(arguments)

    def work() -> None:
        if not chosen.page:
            seed, said = seeded("cures", chosen, given(NAME, arguments))
            with Bars() as bars:
                folder = chosen.work or chosen.out / "checkpoints"
                found = run(folder, chosen.cases, seed, workers=chosen.workers, progress=bars.show)
            write({"": table(chosen.cases, seed, found).assign_attrs(said)}, chosen.out / "cures.nc")
        document(chosen.out, chosen.docs)

    return carried_out(work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
