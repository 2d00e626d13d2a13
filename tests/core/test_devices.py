"""One decision for torch and JAX, and errors of one line."""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from gaugeblock.core.devices import VARIABLE, device_kinds, jax_device, tell_jax, torch_device
from gaugeblock.core.errors import InputError
from gaugeblock.core.processors import processor


@pytest.fixture
def gpus(monkeypatch):
    """Say how many CUDA devices torch and JAX see."""

    def seen(torch=0, jax=0):
        def local_devices(backend=None):
            if backend == "cuda" and not jax:
                raise RuntimeError("Unknown backend cuda")
            kind = "cpu" if backend == "cpu" or not jax else "Card J"
            return [
                SimpleNamespace(device_kind=kind, id=number)
                for number in range(jax if kind == "Card J" else 1)
            ]

        cuda = SimpleNamespace(
            is_available=lambda: torch > 0, device_count=lambda: torch, get_device_name=lambda one: "Card T"
        )
        monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(cuda=cuda))
        monkeypatch.setitem(sys.modules, "jax", SimpleNamespace(local_devices=local_devices))

    return seen


@pytest.fixture(autouse=True)
def _unset(monkeypatch):
    for name in (VARIABLE, "JAX_PLATFORMS", "XLA_PYTHON_CLIENT_PREALLOCATE"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(
    ("asked", "variable", "there", "chosen"),
    [
        (None, None, 2, "cpu"),
        (None, "", 2, "cpu"),
        (None, "auto", 2, "cuda:0"),
        (None, "auto", 0, "cpu"),
        (None, "cuda:1", 2, "cuda:1"),
        ("cpu", "cuda", 2, "cpu"),
        ("cuda", "cpu", 1, "cuda:0"),
        ("auto", "cpu", 1, "cuda:0"),
    ],
)
def test_who_asks_goes_before_the_variable_and_that_before_the_cpu(
    gpus, monkeypatch, asked, variable, there, chosen
):
    gpus(torch=there)
    if variable is not None:
        monkeypatch.setenv(VARIABLE, variable)
    assert torch_device(asked) == chosen


@pytest.mark.parametrize(
    ("asked", "there", "message"),
    [
        ("gpu", 2, r"here 'gpu': no such device; take"),
        ("cuda:x", 2, r"here 'cuda:x': no such device"),
        (1, 2, r"here 1: no such device"),
        ("cuda", 0, r"here 'cuda': torch sees 0 CUDA devices here; take \"auto\" or \"cpu\", or install"),
        ("cuda:2", 2, r"here 'cuda:2': torch sees 2 CUDA devices"),
    ],
)
def test_what_is_not_there_is_one_line(gpus, asked, there, message):
    gpus(torch=there)
    with pytest.raises(InputError, match=message) as caught:
        torch_device(asked, where="here")
    assert "\n" not in str(caught.value)


def test_jax_follows_the_variable(gpus, monkeypatch):
    gpus(torch=2, jax=2)
    assert jax_device().device_kind == "cpu"
    monkeypatch.setenv(VARIABLE, "cuda:1")
    assert (jax_device().device_kind, jax_device().id) == ("Card J", 1)
    gpus(torch=2)
    with pytest.raises(InputError, match=f"{VARIABLE} 'cuda:1': JAX sees 0 CUDA devices"):
        jax_device()
    monkeypatch.setenv(VARIABLE, "auto")
    assert jax_device().device_kind == "cpu"


def test_jax_is_told_before_it_starts(monkeypatch):
    tell_jax()
    assert os.environ["JAX_PLATFORMS"] == "cpu"
    monkeypatch.setenv("JAX_PLATFORMS", "tpu")
    tell_jax()
    assert os.environ["JAX_PLATFORMS"] == "tpu"
    monkeypatch.delenv("JAX_PLATFORMS")
    monkeypatch.setenv(VARIABLE, "cuda")
    tell_jax()
    assert "JAX_PLATFORMS" not in os.environ
    assert os.environ["XLA_PYTHON_CLIENT_PREALLOCATE"] == "false"


def test_commands_tell_it():
    code = (
        "import os, sys\nfrom gaugeblock.cli import main\nsys.argv = ['gaugeblock', '--help']\n"
        "try: main()\nexcept SystemExit: print('JAX', os.environ['JAX_PLATFORMS'])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.endswith("JAX cpu\n")


def test_a_processor_names_what_flows_and_jax_compute_on(gpus, monkeypatch):
    gpus(torch=2)
    assert device_kinds() == device_kinds(["cpu"]) == ["cpu"]
    # Two of a kind are one.
    assert device_kinds(["cuda:0"]) == device_kinds(["cuda:1"]) == ["cpu", "torch on Card T"]
    assert processor("cuda:0").endswith("(cpu, torch on Card T)")
    assert processor("cpu") == processor() != processor("cuda:0")
    # A simulator that leaves JAX to itself would be on its card, ours are not.
    gpus(jax=1)
    assert device_kinds() == ["cpu", "JAX by default on Card J"]
    monkeypatch.setenv(VARIABLE, "cuda")
    assert device_kinds() == ["cpu", "JAX by default on Card J", "JAX on Card J"]
    # Nobody may compute with it.
    gpus()
    assert device_kinds() == ["cpu"]


def test_without_torch_and_jax_nothing_is_imported():
    code = (
        "import sys\nfrom gaugeblock.core.devices import device_kinds, tell_jax, torch_device\n"
        "tell_jax()\nprint(device_kinds(), torch_device(), {'torch', 'jax'} & set(sys.modules))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "['cpu'] cpu set()"


ELSEWHERE = """
import jax, jax.numpy as jnp
from gaugeblock.core import precision
first, second = jax.local_devices()
precision.jax_device = lambda: second
with precision.double_precision():
    made = jnp.ones(3)
print(made.devices() == {second}, made.dtype, jnp.ones(3).devices() == {first}, jnp.ones(3).dtype)
"""


def test_double_precision_is_on_the_chosen_device():
    pytest.importorskip("jax")
    two = {"XLA_FLAGS": "--xla_force_host_platform_device_count=2"}
    ran = subprocess.run(
        [sys.executable, "-c", ELSEWHERE], capture_output=True, text=True, check=False, env=os.environ | two
    )
    assert ran.stdout.split() == ["True", "float64", "True", "float32"], ran.stderr
