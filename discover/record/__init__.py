"""A finished search as plain data and as arrays: discovery.json and discovery.nc."""

from gaugeblock.discovery.record.catalogue import discovery_of
from gaugeblock.discovery.record.e_value import add_e_value
from gaugeblock.discovery.record.evidence import add_evidence
from gaugeblock.discovery.record.summary import summary
from gaugeblock.discovery.record.tree import tree

__all__ = ["add_e_value", "add_evidence", "discovery_of", "summary", "tree"]
