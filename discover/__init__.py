"""Find where simulation and data disagree, name the missing effect, add it, show the gap shrink.

One workflow (`workflow`, `decision`, `record`, `result`) over three engines: `counts` of one source, a
`catalogue` of sources, `simulations` of a simulator without a likelihood. `engine` says what an engine does
and holds the thresholds on which answers hang. Tools: `locate` (where), `name` (which effect), `extend` (the
simulator with it), `confirm` (does it hold on data held out of its fits), `simulated` (scores learned from
simulations).
"""

from gaugeblock.discovery.engine import Thresholds
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.result import Discovery
from gaugeblock.discovery.searches import discover_catalogue, discover_simulated, discover_source
from gaugeblock.discovery.sources import Sources

__all__ = [
    "Candidates",
    "Discovery",
    "Sources",
    "Thresholds",
    "discover_catalogue",
    "discover_simulated",
    "discover_source",
]
