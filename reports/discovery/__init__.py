"""The report of a discovery: what disagrees, what it is, how sure, and how much the gap shrinks.

`schema` says what the report reads: the groups of discovery.nc and the keys of discovery.json. A file per
chapter (`before_after`, `located`, `candidate_chapter`, `held_out`,
`size`, `catalogue`), `headline` for the
paragraph at the top, `html` for the page; `gain` draws the comparison with the published schemes.
"""

from gaugeblock.reports.discovery.gain import gain_headline
from gaugeblock.reports.discovery.headline import headline
from gaugeblock.reports.discovery.html import MODELS, discovery_html, write_discovery

__all__ = ["MODELS", "discovery_html", "gain_headline", "headline", "write_discovery"]
