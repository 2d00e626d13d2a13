"""``python -m studies gain``: a shift that no published check saw, in catalogues, beside three schemes."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from gaugeblock.core.progress import Bars
from studies.gain.document import document
from studies.gain.pools import pools
from studies.gain.study import pieces_of, study, with_sizes
from studies.kit.command import carried_out, given, parser
from studies.kit.results import record, write

NAME = "studies gain"


def main(arguments: Sequence[str]) -> int:
    """Make the pools, read them, and keep the tables."""
    options = with_sizes(parser(NAME, __doc__))
    options.add_argument("--report", action="store_true", help="figure and text of OUT/gain.nc alone")
    chosen = options.parse_args(arguments)

    def work() -> None:
        if chosen.report:
            document(chosen.out / "gain.nc", chosen.docs)
            return
        with Bars() as bars:
            pieces = pieces_of("gain", chosen.seed, chosen, bars.show)
            planned = pools(share=chosen.share)
            groups = study(planned, pieces, seed=chosen.seed, share=chosen.share, number=chosen.catalogues)
        attributes = record(given(NAME, arguments), chosen.seed, share=chosen.share)
        write(groups | {"": groups[""].assign_attrs(attributes)}, chosen.out / "gain.nc")

    return carried_out(work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
