"""How good is a trained flow on fresh simulations? Ranks, coverage, bias, width and importance weights.

    python benchmarks/flow_quality.py                                        # the shipped reference flow
    python benchmarks/flow_quality.py --model FOLDER --trials 4000 --seed 3

Simulator and prior come from the model folder; needs gaugeblock[sbi] and what the simulator needs.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from scipy.stats import kstest

from gaugeblock.core.streams import generator
from gaugeblock.estimators.npe import load, reference_model_path
from gaugeblock.simulators import build_simulator
from gaugeblock.validate.joint.importance import kish_fraction, log_weights
from gaugeblock.validate.joint.psis import pareto_khat
from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.marginal.coverage import inside_central, perfect_estimator
from gaugeblock.validate.ranks import randomised_pit
from gaugeblock.validate.standardised import bias, log_width, standardised_errors


def calibration(simulator, flow, trials, draws, seed):
    """Ranks, coverage, bias and width of every parameter."""
    theta = simulator.prior.sample(trials, generator(seed, "theta"))
    x = simulator.simulate(theta, generator(seed, "data"))
    begun = time.perf_counter()
    sampled = flow.sample(x, draws, generator(seed, "draws"))
    seconds = time.perf_counter() - begun
    ties = generator(seed, "ties")
    pit = randomised_pit(theta, sampled, ties)
    errors = standardised_errors(theta, sampled, ties)
    nominal = np.array(LEVELS)
    gap = inside_central(pit).mean(axis=-1) - nominal
    print(f"{trials} trials x {draws} draws in {seconds:.1f} s")
    titles = f"{'parameter':24s} {'rank KS p':>9s} {'bias/sd':>16s} {'width ratio':>16s}"
    print(f"{titles} {'cov(0.5)':>8s} {'cov(0.95)':>9s}")
    for k, name in enumerate(simulator.prior.names):
        shift, shift_error, _ = bias(errors[:, k])
        width, width_error, _ = log_width(errors[:, k], draws=draws)
        print(
            f"{name:24s} {kstest(pit[:, k], 'uniform').pvalue:9.3f} {shift:+8.4f}+-{shift_error:.4f} "
            f"{np.exp(width):8.4f}+-{width_error:.4f} {gap[k, LEVELS.index(0.5)] + 0.5:8.4f} "
            f"{gap[k, LEVELS.index(0.95)] + 0.95:9.4f}"
        )
    floor, low, high = perfect_estimator(trials, simulator.prior.size)[0]
    perfect = f"a perfect estimator: {floor:.4f}, 95% {low:.4f} to {high:.4f}"
    print(f"coverage deviation {np.abs(gap).mean():.4f} ({perfect})")


def importance(simulator, flow, trials, draws, seed):
    """Kish ESS, k-hat and where the ESS is low."""
    theta = simulator.prior.sample(trials, generator(seed, "theta-importance"))
    x = simulator.simulate(theta, generator(seed, "data-importance"))
    sampled, log_q = flow.sample_and_log_prob(x, draws, generator(seed, "draws-importance"))
    likelihood = simulator.log_likelihood(sampled, x[:, None])
    weight = log_weights(log_q, likelihood, simulator.prior.log_prob(sampled))
    ess, khat = kish_fraction(weight), pareto_khat(weight)
    quantiles = ", ".join(f"{q}%: {np.percentile(ess, q):.3f}" for q in (1, 5, 10, 25, 50, 75, 90))
    print(f"importance on {trials} trials x {draws} draws: k-hat > 0.7 in {np.mean(khat > 0.7):.3f}")
    print(f"  ESS fraction {quantiles}")
    total = np.asarray(x, dtype=float).reshape(trials, -1).sum(axis=1)
    for low, high in ((0.0, 1 / 3), (1 / 3, 2 / 3), (2 / 3, 1.0)):
        edges = np.quantile(total, [low, high])
        chosen = (total >= edges[0]) & (total <= edges[1])
        print(f"  sum of data {edges[0]:9.1f} to {edges[1]:9.1f}: median ESS {np.median(ess[chosen]):.3f}")


def main():
    layout = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=layout)
    parser.add_argument("--model", type=Path, help="model folder; the shipped reference flow if left out")
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--importance-trials", type=int, default=500)
    parser.add_argument("--importance-draws", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    folder = options.model or reference_model_path()
    table = json.loads((folder / "model.json").read_text())["simulator_table"]
    simulator = build_simulator(table.pop("name"), **table)
    flow = load(folder, simulator)
    print(f"{folder}: sha256 {flow.record['sha256'][:12]}, seed {options.seed}")
    calibration(simulator, flow, options.trials, options.draws, options.seed)
    importance(simulator, flow, options.importance_trials, options.importance_draws, options.seed)


if __name__ == "__main__":
    main()
