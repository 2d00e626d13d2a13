"""Calibration as the study asked it, on levels whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest
from studies.paper.calibration import bootstrapped, coverage, deviation, rank_p, recovery
from studies.paper.experiment import committed
from studies.paper.experiments import load
from studies.paper.experiments.calibration_published import measured
from studies.paper.numbers import alone, by_claim

RNG = np.random.default_rng(11)


def test_uniform_levels_are_calibrated() -> None:
    levels = RNG.random((4000, 5))
    assert rank_p(levels).min() > 1e-3
    assert coverage(0.68, levels) == pytest.approx(0.68, abs=0.02)
    # 0.0156 of 400 spectra and sqrt(10) less of ten times as many.
    assert float(deviation(levels)) == pytest.approx(0.005, abs=0.003)


def test_intervals_that_are_too_narrow_show_and_are_mended_by_other_spectra() -> None:
    narrow = 0.5 + 0.5 * np.sign(RNG.random((800, 5)) - 0.5) * RNG.random((800, 5)) ** 0.5
    first, test = narrow[:400], narrow[400:]
    assert rank_p(test).max() < 1e-3
    assert coverage(0.5, test) == pytest.approx(0.25, abs=0.05)
    assert coverage(0.5, test, first) == pytest.approx(0.5, abs=0.06)
    assert float(deviation(test)) > 0.1 > 0.04 > float(deviation(test, first))


def test_recovery_is_a_correlation_parameter_by_parameter() -> None:
    truth = RNG.random((500, 3))
    assert recovery(truth, truth * [1.0, 2.0, 3.0] + 5.0) == pytest.approx(1.0)
    assert abs(recovery(truth, RNG.permutation(truth))) < 0.15


def test_rows_of_table_2_and_p_values_are_one_networks_and_the_others_means() -> None:
    table = committed("calibration_published")
    assert table is not None
    found, first, mean = measured(table), by_claim(alone(table)), by_claim(table)
    for claim in ("tab2.production", "cal.sbc.pn.faint"):
        assert found[claim].parts == first[claim] != mean[claim]
        assert found[claim].trainings == 1
    assert found["cal.dev.pn.faint"].parts == mean["cal.dev.pn.faint"]
    assert found["cal.dev.pn.faint"].trainings == table.sizes["training"] > 2


def test_on_nicer_p_values_are_one_networks_and_our_own_flows_stand_beside() -> None:
    table, ours = committed("calibration_nicer"), committed("calibration_ours")
    assert table is not None
    assert ours is not None
    found, first, beside = load("calibration_nicer").measured(table), by_claim(alone(table)), by_claim(ours)
    assert set(beside) == set(found)
    for level in ("faint", "medium", "bright"):
        ranks, deviates = found[f"cal.sbc.nicer.{level}"], found[f"cal.dev.nicer.{level}"]
        assert (ranks.parts, ranks.trainings) == (first[f"cal.sbc.nicer.{level}"], 1)
        assert (deviates.parts, deviates.trainings) == (by_claim(table)[f"cal.dev.nicer.{level}"], 3)
        told = beside[f"cal.dev.nicer.{level}"]["value"]
        assert deviates.note == f"flows of our own give {told:.4g}"


def test_bootstrap_errors_are_those_of_a_mean() -> None:
    values = RNG.normal(size=400)
    mean, error = bootstrapped(lambda a: float(a.mean()), values, rng=RNG)
    assert mean == values.mean()
    assert error == pytest.approx(1.0 / 20.0, rel=0.2)
    _, both = bootstrapped(lambda a, b: float((a - b).mean()), values, values, rng=RNG, together=True)
    assert both < 1e-12
