"""Reference pages, made of docstrings, tables of the configuration and options of the commands."""

from __future__ import annotations

import inspect
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import typer
from pydantic import BaseModel

import gaugeblock
from gaugeblock.auditing.config import AuditConfig
from gaugeblock.cli import app
from gaugeblock.validate.policy import Policy


def python() -> str:
    """Every public name of `gaugeblock`, by its docstring."""
    lines = ["# Python", "", "Everything in `dir(gaugeblock)`.", ""]
    for name in dir(gaugeblock):
        thing = getattr(gaugeblock, name)
        lines += [f"::: {thing.__module__}.{thing.__qualname__}", ""]
    return "\n".join(lines)


def configuration() -> str:
    """Every key of the three kinds of TOML file, with its type and default."""
    parts = [
        "# Configuration",
        "Keys of the TOML files, each with its default. [Audits](../audit.md) says what they mean.",
    ]
    # By its file: the room that it is of needs torch.
    training = runpy.run_path(str(Path(gaugeblock.__file__).parent / "estimators" / "npe" / "config.py"))
    titles = ((AuditConfig, "An audit"), (Policy, "A policy"), (training["TrainingConfig"], "A training"))
    for model, title in titles:
        parts += [f"## {title}", *_tables(model, "")]
    return "\n\n".join(parts) + "\n"


def _tables(model: type[BaseModel], path: str) -> Iterator[str]:
    rows, inner = ["| key | type | default |", "|---|---|---|"], []
    for name, field in model.model_fields.items():
        found = _model(field.annotation)
        if found is not None and found.model_fields and found.model_config.get("extra") == "forbid":
            inner.append((f"{path}.{name}" if path else name, found))
            continue
        default = (
            "required" if field.is_required() else f"`{_plain(field.get_default(call_default_factory=True))}`"
        )
        rows.append(f"| `{name}` | {_code(_type(field.annotation))} | {default} |")
    if path:
        yield f"### `[{path}]`"
    yield "\n".join(line for line in inspect.cleandoc(model.__doc__ or "").split("\n\n>>>")[0].splitlines())
    if len(rows) > 2:
        yield "\n".join(rows)
    for name, found in inner:
        yield from _tables(found, name)


def _model(annotation: Any) -> type[BaseModel] | None:
    kinds = [annotation, *get_args(annotation)]
    return next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)), None)


def _type(annotation: Any) -> str:
    return (
        annotation.__name__ if isinstance(annotation, type) and not get_args(annotation) else str(annotation)
    )


def _plain(default: Any) -> str:
    if isinstance(default, BaseModel):
        return str(default.model_dump())
    return f'"{default}"' if isinstance(default, str) else str(default)


def _code(text: str) -> str:
    return "`" + text.replace("typing.", "") + "`"


def command_line() -> str:
    """Every command with its arguments and options, from the program itself."""
    parts = ["# Command line", "`gaugeblock COMMAND --help` says the same."]
    main: Any = typer.main.get_command(app)
    for name, command in sorted(main.commands.items()):
        if hasattr(command, "commands"):
            for inner, one in sorted(command.commands.items()):
                parts += _command(f"{name} {inner}", one)
        else:
            parts += _command(name, command)
    return "\n\n".join(parts) + "\n"


def _command(name: str, command: Any) -> Iterator[str]:
    context = command.context_class(command, info_name=f"gaugeblock {name}")
    yield f"## gaugeblock {name}"
    yield inspect.cleandoc(command.help or "").replace("\b", "").replace("\f", "")
    yield "\n".join(
        ["```text", " ".join(["gaugeblock", name, *command.collect_usage_pieces(context)]), "```"]
    )
    rows = ["| option | |", "|---|---|"]
    for one in command.get_params(context):
        record = one.get_help_record(context)
        if record is not None:
            said = record[1].replace("|", r"\|")
            rows.append(f"| `{record[0]}` | {said} |")
    if len(rows) > 2:
        yield "\n".join(rows)
    if command.epilog:
        yield inspect.cleandoc(command.epilog)
