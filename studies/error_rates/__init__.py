"""The study of gaugeblock's own error rates: what the validators and the gate do when the answer is known.

`problem.py` and `boundary.py` make estimators whose faults are known exactly, `audits.py` audits them in
memory, `replicates.py` repeats that with seeds of their own; `size.py`, `gate.py`, `intervals.py`,
`shortcut.py`, `edges.py`, `regions.py`, `caught.py`, `blind.py`, `retraining.py`, `power.py`, `curves.py` and
`anytime.py` are the parts of the study; `plots.py` and `document.py` make figures and text from the results.
"""
