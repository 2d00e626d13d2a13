"""Somebody else's estimator, in a sandbox.

`mapping.py` translates between its parameters and the simulator's; `listing.py` says what a pickle would
import, without loading it.
"""
