"""Scores learned from simulations, for a simulator that can only simulate.

`features` turns data into numbers, `population` and `model` say what is simulated, `learning` learns how the
features answer to everything that may change, `moment_fit` fits population and effects by that, `score_tests`
tests every effect, `extend` adds one, `judged` judges it on other data sets, `closing_in` finds where theta
lies.
"""
