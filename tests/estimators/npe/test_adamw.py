"""The optimizer that spares torch's compiler: the same bits as torch's own."""

import subprocess
import sys
from functools import partial

import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("sbi")

from gaugeblock.estimators.npe.adamw import AdamW  # noqa: E402

STEPS = """
import sys, torch
from gaugeblock.estimators.npe.adamw import AdamW
weight = torch.nn.Parameter(torch.ones(3))
one = AdamW([weight], lr=0.1)
one.zero_grad()
(weight**2).sum().backward()
one.step()
one.load_state_dict(one.state_dict())
assert weight[0] < 1
print("torch._dynamo" in sys.modules)
"""


def descended(kind, steps, state=None, start=None):
    """Weights and the optimizer's state after steps down a slope that is not the same everywhere."""
    weight = torch.nn.Parameter(torch.tensor([1.0, -2.0, 0.3]) if start is None else start.clone())
    optimizer = kind([weight], lr=0.05, betas=(0.9, 0.99), weight_decay=0.1)
    if state is not None:
        optimizer.load_state_dict(state)
    for _ in range(steps):
        optimizer.zero_grad()
        ((weight - torch.tensor([0.2, 0.5, 4.0])) ** 4).sum().backward()
        optimizer.step()
    return weight.detach(), optimizer.state_dict()


def test_it_is_torchs_own_to_the_bit_and_goes_on_where_it_stopped():
    theirs, _ = descended(partial(torch.optim.AdamW, fused=True), 7)
    ours, _ = descended(AdamW, 7)
    assert torch.equal(ours, theirs)
    half, state = descended(AdamW, 3)
    gone_on, _ = descended(AdamW, 4, state, half)
    assert torch.equal(gone_on, theirs)


def test_a_device_without_such_a_kernel_is_served_too(monkeypatch):
    monkeypatch.setattr("gaugeblock.estimators.npe.adamw.FUSED", frozenset({"cuda"}))
    theirs, _ = descended(torch.optim.AdamW, 7)
    assert torch.equal(descended(AdamW, 7)[0], theirs)
    assert not AdamW([torch.nn.Parameter(torch.ones(1))]).param_groups[0]["fused"]


def test_torchs_compiler_is_not_imported():
    done = subprocess.run([sys.executable, "-c", STEPS], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
