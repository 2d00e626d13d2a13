"""Does a wrongly trained flow PASS once it is trained again as its diagnosis says, and not without?"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from gaugeblock.core.progress import Bars
from studies.cures.document import document
from studies.cures.measure import run, table
from studies.kit.command import carried_out, given, parser
from studies.kit.commit import ROOT, committed, seed_of
from studies.kit.results import record, write

NAME = "studies cures"


def main(arguments: Sequence[str]) -> int:
    """Train, diagnose and train again; or fill the page from what is stored."""
    options = parser(NAME, __doc__)
    options.add_argument("--cases", type=int, default=120)
    options.add_argument("--commit", default="HEAD", help="of the code that is measured: draws the cases")
    options.add_argument("--generator-seed", type=int, help="in place of the one that the commit gives")
    options.add_argument("--report", action="store_true", help="text from OUT; nothing is run")
    chosen = options.parse_args(arguments)

    def work() -> None:
        if not chosen.report:
            own = chosen.generator_seed
            commit = committed(ROOT, chosen.commit) if own is None else ""
            seed = seed_of("cures", commit) if own is None else own
            with Bars() as bars:
                folder = chosen.work or chosen.out / "checkpoints"
                found = run(folder, chosen.cases, seed, workers=chosen.workers, progress=bars.show)
            said = record(given(NAME, arguments), chosen.seed, commit=commit, generator_seed=str(seed))
            write({"": table(chosen.cases, seed, found).assign_attrs(said)}, chosen.out / "cures.nc")
        document(chosen.out, chosen.docs)

    return carried_out(work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
