"""Tables of TOML: read from files, checked by pydantic, wrong in one line."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from gaugeblock.core.errors import InputError, one_line
from gaugeblock.core.foreign import read_text

# No table of ours is nested more than a few times.
DEPTH = 50
Model = TypeVar("Model", bound=BaseModel)


class Table(BaseModel):
    """A table whose keys are all known and that does not change once it is checked."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Named(BaseModel):
    """A simulator or an estimator: its registered name (or ``module:object``) and that one's options."""

    model_config = ConfigDict(extra="allow", frozen=True)
    name: str

    @property
    def options(self) -> dict[str, Any]:
        """Everything but the name."""
        return dict(self.model_extra or {})

    @property
    def table(self) -> dict[str, Any]:
        """Name and options together, as a configuration holds them."""
        return {"name": self.name, **self.options}


def read_toml(path: str | os.PathLike[str], *, remedy: str = "give a TOML file") -> dict[str, Any]:
    """The content of a TOML file.

    Raises
    ------
    InputError
        If it cannot be read, with the remedy, or is not TOML.
    """
    text = read_text(path, remedy=remedy)
    try:
        content = tomllib.loads(text)
        if _deeper(content, DEPTH):
            raise RecursionError
    except ValueError as error:  # of the parser, or of a number with too many digits
        raise InputError(f"{path}: is not TOML: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: is not TOML of ours: nested too deeply") from None
    return content


def _deeper(content: Any, depth: int) -> bool:
    """Whether tables or lists hold more than so many others, one in the other."""
    level = [content]
    for _ in range(depth):
        level = [
            inner
            for one in level
            if isinstance(one, dict | list)
            for inner in (one.values() if isinstance(one, dict) else one)
        ]
    return bool(level)


def checked(model: type[Model], values: Mapping[str, Any], *, where: str) -> Model:
    """Plain data as the model; `where` is named in front of what is wrong with them.

    Raises
    ------
    InputError
        One line that names the first key that is unknown or whose value cannot be used.
    """
    try:
        return model.model_validate(dict(values))
    except ValidationError as error:
        raise InputError(one_line(f"{where}: {complaint(error, model)}")) from None


def complaint(error: ValidationError, model: type[BaseModel]) -> str:
    """The first thing wrong with a table, in one line: which key, what it was, what it may be."""
    problem = error.errors()[0]
    location = [str(part) for part in problem["loc"]]
    key = ".".join(location)
    if problem["type"] == "extra_forbidden":
        return f"unknown key {key}; there are {', '.join(_known_keys(model, location[:-1]))}"
    if problem["type"] == "missing":
        return f"{key} is missing"
    said = str(problem["msg"]).removeprefix("Value error, ")
    if problem["type"] in ("dict_type", "model_type"):
        said = "it must be a table"
    said = said[0].lower() + said[1:]
    if isinstance(problem["input"], dict):  # the keys of a table do not fit together
        return f"{key or 'top level'}: {said}"
    return f"{key} = {problem['input']!r} cannot be: {said}"


def _known_keys(model: type[BaseModel], tables: list[str]) -> list[str]:
    for name in tables:
        inner = model.model_fields[name].annotation
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            break
        model = inner
    return list(model.model_fields)
