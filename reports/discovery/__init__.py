"""The report of a discovery: what disagrees, what it is, how sure, and how much the gap shrinks.

`schema` says what the report reads: the groups of discovery.nc and the keys of discovery.json.
"""
