"""The published study's network, trained as the study did: for its reproduction, not for use.

`paper_flow` loads a trained one, ``python -m studies.paper.paper_flow`` trains them.
"""

from studies.paper.paper_flow.shipped import FLOWS, paper_flow, record_of
from studies.paper.paper_flow.variants import ON_NICER, TRAININGS, VARIANTS, Variant

__all__ = ["FLOWS", "ON_NICER", "TRAININGS", "VARIANTS", "Variant", "paper_flow", "record_of"]
