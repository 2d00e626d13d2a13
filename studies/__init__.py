"""Studies: what is measured once and committed. ``python -m studies`` lists them and runs one.

`error_rates/`, `hidden/`, `gain/` and `paper/` are the studies, `discoveries.py` holds what discovery says
against what it said before; `kit/` is what all of them share, `results/` what they found.
"""
