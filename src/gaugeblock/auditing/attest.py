"""Attest: sign what was derived again from the trials, and nothing else."""

from __future__ import annotations

from pathlib import Path

from gaugeblock.auditing.statement import signed
from gaugeblock.auditing.verify import verify
from gaugeblock.core.envelope import private_key
from gaugeblock.core.errors import InputError


def attest(folder: Path, key: Path, *, trials: Path | None = None, out: Path | None = None) -> Path:
    """Verify the audit in a folder, and write a statement on it that is signed by a key; where that is.

    `trials` is the Trials file, where it is not in the folder, and `out` the statement's file.

    Raises
    ------
    InputError
        If the key cannot be used, the audit is not what its trials give, or there is another statement.
    MissingExtraError
        Without cryptography.
    """
    owner = private_key(key)
    found = verify(folder, trials=trials)
    if found.differences:
        raise InputError(
            f"{folder}: nothing is signed that is not what its trials give ({found.differences[0]}); "
            "`gaugeblock verify` says more"
        )
    return signed(folder, owner, trials=trials, out=out)
