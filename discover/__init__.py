"""Find where simulation and data disagree, name the missing effect, add it, show the gap shrink.

Rooms: `locate` (where), `name` (which effect), `extend` (the simulator with it), `confirm` (does it hold on
data that did not choose it).
"""

from gaugeblock.discovery.candidates import Candidates, candidates
from gaugeblock.discovery.discovery import Discovery
from gaugeblock.discovery.run import discover, discover_catalogue
from gaugeblock.discovery.sources import Sources

__all__ = ["Candidates", "Discovery", "Sources", "candidates", "discover", "discover_catalogue"]
