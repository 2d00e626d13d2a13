"""What a stranger finds around it: a few fixed variables, and users and hosts that we made up."""

from __future__ import annotations

from pathlib import Path

from gaugeblock.stranger.limits import Limits
from gaugeblock.stranger.material import Material

NAME = "stranger"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


def environment(limits: Limits) -> dict[str, str]:
    """Every variable that is set.

    >>> environment(Limits(threads=2))["OMP_NUM_THREADS"]
    '2'
    """
    return {
        "PATH": "/usr/local/bin:/usr/bin:/bin",
        "HOME": "/tmp",
        "TMPDIR": "/tmp",
        "USER": NAME,
        "LOGNAME": NAME,
        "LANG": "C.UTF-8",
        "TZ": "UTC",
        "JAX_PLATFORMS": "cpu",
        "CUDA_VISIBLE_DEVICES": "",
        **dict.fromkeys(THREADS, str(limits.threads)),
    }


def system_files(material: Material, user: int | None) -> dict[str, Path]:
    """Files of /etc that programs ask for, with nothing of this machine's in them: place -> file."""
    number = 65534 if user is None else user
    texts = {
        "passwd": f"{NAME}:x:{number}:{number}::/tmp:/bin/sh\n",
        "group": f"{NAME}:x:{number}:\n",
        "hosts": "127.0.0.1 localhost\n",
        "nsswitch.conf": "passwd: files\ngroup: files\nhosts: files\n",
    }
    return {f"/etc/{name}": material.write(name, text) for name, text in texts.items()}
