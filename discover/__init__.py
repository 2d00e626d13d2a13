"""Find where simulation and data disagree, name the missing effect, add it, show the gap shrink.

Rooms: `locate` (where), `name` (which effect), `extend` (the simulator with it), `confirm` (does it hold on
data that did not choose it).
"""
