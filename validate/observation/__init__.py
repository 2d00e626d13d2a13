"""Could a simulator have made an observation? Statistics on arrays of it and of simulated data sets.

`views` learn on simulations how data sets can be odd; `ranking` ranks an observation among fresh simulations
that went through the same views, `where` names the coordinates, `planted` and `ladder` say how large a
discrepancy would have been seen, `generic` tries effects that any array can have.
"""

from gaugeblock.validate.observation.sets import Sets

__all__ = ["Sets"]
