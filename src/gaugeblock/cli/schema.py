"""The command that publishes JSON schemas, and holds configurations against what would be refused."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gaugeblock.cli.voice import hand_over, say


def schema(
    name: Annotated[str, typer.Argument(metavar="NAME", help="configuration, verdict or discovery.")],
    files: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[FILE.toml ...]", help="Configurations to check, as an audit would."),
    ] = None,
) -> None:
    """Print the JSON schema of a configuration, verdict.json or discovery.json; or check configurations."""
    import json

    from gaugeblock.auditing.config import read_config
    from gaugeblock.auditing.schemas import SCHEMAS
    from gaugeblock.core.errors import InputError

    if name not in SCHEMAS:
        raise InputError(f"schema: there is none of {name}; there are {', '.join(SCHEMAS)}")
    if not files:
        made = SCHEMAS[name]()
        hand_over(made)
        say(json.dumps(made, indent=2, ensure_ascii=False))
        return
    if name != "configuration":
        raise InputError(f"schema: of {name} only the schema; any validator of JSON schemas takes it")
    for file in files:
        read_config(file)
        say(f"{file}: can be audited")
    hand_over({"files": [str(file) for file in files]})
