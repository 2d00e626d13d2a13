"""Effects hidden by somebody else: does `gaugeblock.discovery` find them, and name none where there is none?

`instrument.py`, `spectrum.py`, `detector.py` and `truth.py` make data by code of their own: nothing of
`gaugeblock.simulators.xray` is in them. `draws.py` and `strata.py` say what is hidden where; `seal.py` keeps
the answers apart from the data, behind a hash; `distance.py` says which cases can be told from their nearest
rival at all; `engine.py` runs discovery, `score.py` opens the answers, `document.py` writes the page.
"""
