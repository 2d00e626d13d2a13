"""Find where simulation and data disagree, name the missing effect, add it, show the gap shrink.

Rooms: `locate` (where), `name` (which effect), `extend` (the simulator with it), `confirm` (does it hold on
data that did not choose it).
"""

from gaugeblock.discover.candidates import Candidates, candidates
from gaugeblock.discover.discovery import Discovery
from gaugeblock.discover.run import discover, discover_catalogue
from gaugeblock.discover.sources import Sources

__all__ = ["Candidates", "Discovery", "Sources", "candidates", "discover", "discover_catalogue"]
