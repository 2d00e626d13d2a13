"""What is run, and what of it is seen where, before anything runs."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.stranger.material import Material
from gaugeblock.stranger.program import CHILD, Places, find_interpreter, own_program, python_program


@pytest.fixture
def places() -> Iterator[Callable[[bool], Places]]:
    made: list[Material] = []

    def make(inside: bool) -> Places:
        made.append(Material())
        return Places(made[-1], inside=inside)

    yield make
    for one in made:
        one.close()


@pytest.fixture
def given(tmp_path: Path) -> Callable[[str], Path]:
    """A file of a name, which is all that it holds."""

    def write(name: str) -> Path:
        path = tmp_path / name
        path.write_text(name)
        return path

    return write


@pytest.fixture
def python(tmp_path: Path) -> Path:
    """An interpreter with a library, outside the system."""
    installation = tmp_path / "installation"
    (installation / "bin").mkdir(parents=True)
    (installation / "lib" / "python3.11").mkdir(parents=True)
    (installation / "lib" / "python3.11" / "os.py").write_text("")
    path = installation / "bin" / "python3"
    path.write_bytes(b"\x7fELF")
    path.chmod(0o755)
    return path


@pytest.mark.parametrize("inside", [True, False])
def test_a_model_with_all_that_belongs_to_it(places: Any, given: Any, python: Path, inside: bool) -> None:
    where = places(inside)
    folder = where.material.folder
    options = {"width": 3, "source": str(given("script.py"))}
    found = python_program(
        where,
        given("theirs.py"),
        "python",
        python=str(python),
        builder=f"{given('build.py')}:make",
        options=options,
    )
    root, server = ("/srv", "/srv/server") if inside else (str(folder), str(CHILD))
    *words, setting = found.words
    assert words == [str(python), "-I", "-B", f"{server}/serve.py"]
    assert json.loads(setting) == {
        "format": "python",
        "path": f"{root}/model/theirs.py",
        "options": {
            "width": 3,
            "source": f"{root}/source/script.py",
            "builder": f"{root}/builder/build.py:make",
        },
    }
    assert found.show == {
        "/srv/model/theirs.py": folder / "model" / "theirs.py",
        "/srv/source/script.py": folder / "source" / "script.py",
        "/srv/builder/build.py": folder / "builder" / "build.py",
        "/srv/server": CHILD,
        str(python.parent.parent): python.parent.parent,
    }
    # The same wherever it lies; and what was given is left as it was.
    assert found.said == {
        "format": "python",
        "format_options": {"width": 3, "source": "script.py"},
        "builder": "build.py:make",
    }
    assert options["source"] == str(given("script.py"))
    assert all(path.read_text() == path.name for place, path in found.show.items() if path.is_file())


def test_a_source_that_is_no_name_of_a_file_is_an_option(places: Any, given: Any, python: Path) -> None:
    found = python_program(
        places(True), given("theirs.py"), "python", python=str(python), builder=None, options={"source": 5}
    )
    assert json.loads(found.words[-1])["options"] == {"source": 5}
    assert found.said == {"format": "python", "format_options": {"source": 5}}
    for builder in ("build.py:", "build.py", "build.py:a b"):
        with pytest.raises(InputError, match=r"expected FILE\.py:function"):
            python_program(
                places(True), given("theirs.py"), "python", python=str(python), builder=builder, options={}
            )
    with pytest.raises(InputError, match="only plain data reach the stranger"):
        python_program(
            places(True),
            given("theirs.py"),
            "python",
            python=str(python),
            builder=None,
            options={"a": {1}},
        )


@pytest.mark.parametrize("inside", [True, False])
def test_a_command_with_interpreter_program_and_model(
    places: Any, given: Any, python: Path, inside: bool
) -> None:
    where = places(inside)
    root = "/srv" if inside else str(where.material.folder)
    program, model, other = given("program.py"), given("model.pt"), given("other.py")
    words = ["{python}", "-u", str(program), "--model={model}", str(other), "{model}"]
    found = own_program(where, words, model, python=str(python))
    own = f"{root}/program/program.py", f"--model={root}/model/model.pt"
    assert found.words == (str(python), "-u", *own, str(other), f"{root}/model/model.pt")
    assert found.said == {
        "format": "command",
        "command": ["{python}", "-u", "program.py", "--model={model}", str(other), "{model}"],
    }
    assert found.show == {
        "/srv/program/program.py": where.material.folder / "program" / "program.py",
        "/srv/model/model.pt": where.material.folder / "model" / "model.pt",
        str(python.parent.parent): python.parent.parent,
    }


def test_a_command_of_the_system_shows_nothing_more(places: Any, python: Path) -> None:
    found = own_program(places(True), "/bin/sh -c 'echo {model} {python}'", None, python=str(python))
    assert found.words == ("/bin/sh", "-c", "echo {model} {python}")
    assert (found.show, found.said["command"]) == ({}, list(found.words))
    # What lies beside the interpreter is seen with it, and is not taken for the program.
    library = str(python.parent.parent / "lib" / "python3.11" / "os.py")
    assert own_program(places(True), ["{python}", library], None, python=str(python)).words[1] == library
    assert own_program(places(True), [library], None, python=str(python)).words == ("/srv/program/os.py",)
    running = own_program(places(True), "{python} -V", None, python=None)
    assert running.words[0] == str(find_interpreter(sys.executable).executable)
    for path in running.show.values():
        assert not path.is_relative_to("/usr")


def test_links_to_an_interpreter_are_followed_one_by_one(python: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    (other / "lib" / "python3.12").mkdir(parents=True)
    (other / "lib" / "python3.12" / "os.py").write_text("")
    environment = tmp_path / "environment"
    (environment / "bin").mkdir(parents=True)
    (environment / "pyvenv.cfg").write_text(
        f"other = /nowhere/bin\nhome = {other / 'bin'}\nhome = /later/bin\n"
    )
    (environment / "bin" / "python").symlink_to("../../installation/bin/../bin/python3")
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "python").symlink_to(environment / "bin" / "python")
    found = find_interpreter(tmp_path / "bin" / "python")
    assert found.executable == environment / "bin" / "python"
    assert found.folders == (environment, python.parent.parent, other)
    # Without a library beside it, the file alone.
    alone = tmp_path / "alone" / "bin" / "python"
    alone.parent.mkdir(parents=True)
    alone.write_bytes(b"\x7fELF")
    alone.chmod(0o755)
    assert find_interpreter(alone).folders == (alone,)
    alone.chmod(0o644)
    with pytest.raises(InputError, match="is no Python interpreter"):
        find_interpreter(alone.parent)
