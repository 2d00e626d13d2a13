"""A repository with an sbi flow of its own gets a gate, as its page says: blocked, mended, passing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
MODEL = """
import numpy as np
import torch
from sbi.utils import BoxUniform

prior = BoxUniform(torch.tensor([0.5, 0.1]), torch.tensor([3.0, 1.0]))
t = np.linspace(-1, 1, 12)


def simulate(theta, rng):
    theta = np.asarray(theta)
    y = theta[:, :1] * t + theta[:, 1:] * rng.normal(size=(len(theta), 12))
    slope = y @ t / (t @ t)
    return np.stack([slope, np.log((y - slope[:, None] * t).std(axis=1))], axis=1)
"""
TRAIN = """
import sys

import numpy as np
import torch
from model import prior, simulate
from sbi.inference import NPE

torch.manual_seed(1)
theta = prior.sample((int(sys.argv[1]),))
x = torch.as_tensor(simulate(theta.numpy(), np.random.default_rng(1)), dtype=torch.float32)
trainer = NPE(prior, density_estimator="maf", show_progress_bars=False)
net = trainer.append_simulations(theta, x).train(max_num_epochs=int(sys.argv[2]))
torch.save(trainer.build_posterior(net), "posterior.pt")
"""
ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "MKL", "OPENBLAS")}


@pytest.mark.slow
def test_a_gate_is_added_blocks_says_why_and_passes_when_the_flow_is_mended(tmp_path, runner):
    pytest.importorskip("sbi")
    (call,) = re.findall(r"`(calibration_gate\(torch\..*?\))`\.", (ROOT / "docs/how-to/gate.md").read_text())
    gate = (
        f"import torch\nfrom model import prior, simulate\n\n\ndef test_flow(calibration_gate):\n    {call}\n"
    )
    files = {"model.py": MODEL, "train.py": TRAIN, "test_calibration.py": gate, "pytest.ini": "[pytest]\n"}
    for name, text in files.items():
        (tmp_path / name).write_text(text)

    def gated(simulations, epochs):
        trained = runner.run(
            f"python -W ignore train.py {simulations} {epochs}", tmp_path, ONE_THREAD, timeout=900
        )
        assert trained.code == 0, trained.stderr
        run = "python -m pytest -p no:cacheprovider test_calibration.py"
        return runner.run(run, tmp_path, ONE_THREAD, timeout=900)

    blocked = gated(300, 20)
    assert blocked.code == 1, blocked.stdout
    assert re.search(r"^FAIL: \d+ of \d+ gates failed", blocked.stdout, re.MULTILINE)
    assert "Diagnosis: " in blocked.stdout
    assert "noise" in blocked.stdout
    passed = gated(10_000, 60)
    assert passed.code == 0, passed.stdout
    assert "PASS test_calibration.py::test_flow" in passed.stdout
