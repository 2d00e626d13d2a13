"""Somebody else's estimator, in a sandbox.

`stranger.py` is the estimator. `sandbox.py` confines its child, with `system_calls.py`, `limits.py`,
`watchdog.py` and `usage.py`; `surroundings.py`, `interpreter.py` and `material.py` are what it gets to see,
`program.py` what runs in it. `process.py` talks to the child, in the words of `wire.py`; `claims.py` is what
it says of itself. `detect.py` finds the format of a file, `mapping.py` translates between its parameters and
the simulator's, `listing.py` says what a pickle would import, without loading it. `child/` runs over there
and imports nothing of gaugeblock.
"""
