"""Faults hidden by somebody else: does `gaugeblock.diagnosis` name them, and none where there is none?

`laws.py`, `problems.py` and `operators.py` make exact posteriors and break them by code of their own: nothing
of gaugeblock is in them. `catalogue.py` says which faults are hidden, how large and where; `rivals.py` says,
from the laws themselves, which other symptoms would explain a case as well; `seal.py` keeps the answers apart
behind a hash; `measure.py` runs the audit and the diagnosis under test, `score.py` opens the answers,
`document.py` writes the page.
"""
