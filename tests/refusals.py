"""What is said to whoever asks for what cannot be."""

from __future__ import annotations

from typing import Any

import pytest

from gaugeblock.core.errors import InputError


def said(
    call: Any, *args: Any, kind: type[Exception] | tuple[type[Exception], ...] = InputError, **options: Any
) -> str:
    """The message that a call ends with; that it ends with one of this `kind` is asserted."""
    with pytest.raises(kind) as caught:
        call(*args, **options)
    return str(caught.value)
