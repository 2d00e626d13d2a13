"""Flows that are really trained under a fault, diagnosed, and trained again as the diagnosis says.

`training` what a recipe is, and flows by it; `catalogue` what is wrong with recipes, and which part of one
each cure puts right; `measure` the trial; `document` its page.
"""
