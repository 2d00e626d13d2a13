"""A finished search as plain data and as arrays: discovery.json and discovery.nc."""

from gaugeblock.discover.record.catalogue import discovery_of
from gaugeblock.discover.record.e_value import add_e_value
from gaugeblock.discover.record.evidence import add_evidence
from gaugeblock.discover.record.summary import summary
from gaugeblock.discover.record.tree import tree

__all__ = ["add_e_value", "add_evidence", "discovery_of", "summary", "tree"]
