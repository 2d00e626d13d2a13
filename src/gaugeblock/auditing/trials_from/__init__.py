"""Trials from what other packages leave behind: their draws and truths, with none of them imported.

`trials_from_sbi` draws with an sbi posterior in hand; the others take what was drawn. Each gives a Trials
Dataset, which `gaugeblock.write_trials` writes for ``gaugeblock audit --trials``; `to_arviz` goes back.
"""

from gaugeblock.auditing.trials_from.arviz import trials_from_arviz
from gaugeblock.auditing.trials_from.arviz_groups import to_arviz
from gaugeblock.auditing.trials_from.bayesflow import trials_from_bayesflow
from gaugeblock.auditing.trials_from.numpyro import trials_from_numpyro
from gaugeblock.auditing.trials_from.reading import any_trials
from gaugeblock.auditing.trials_from.samplers import trials_from_samplers
from gaugeblock.auditing.trials_from.sbi import trials_from_sbi

__all__ = [
    "any_trials",
    "to_arviz",
    "trials_from_arviz",
    "trials_from_bayesflow",
    "trials_from_numpyro",
    "trials_from_samplers",
    "trials_from_sbi",
]
