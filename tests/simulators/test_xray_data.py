"""Fetching: verified, written whole, mended when damaged, and never silent for long."""

import subprocess
import threading
import time
import zipfile
from dataclasses import replace

import pytest

from gaugeblock.core.errors import InputError

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import data

HELLO = data.hashlib.sha256(b"hello").hexdigest()


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache that wants two small files."""
    wanted = {
        name: data.DataFile(name, tmp_path / "cache" / name, HELLO, f"http://localhost/{name}")
        for name in ("a/one.rmf", "two.arf")
    }
    monkeypatch.setattr(data, "files", lambda: wanted)
    return wanted


def gives(*names, content=b"hello"):
    def source(wanted, tell):
        for file in wanted:
            if file.name in names:
                tell(file.name)
                file.store(content)

    return source


def fails(wanted, tell):
    raise data.SourceError("is on holiday")


def test_sources_are_tried_in_order_until_nothing_is_missing(cache):
    said = []
    report = data.fetch(
        progress=said.append,
        sources={"first": fails, "second": gives("two.arf"), "third": gives("a/one.rmf"), "fourth": fails},
    )
    assert report.origin == {"two.arf": "second", "a/one.rmf": "third"}
    assert report.summary() == "2 files, sha256 verified: 1 from second, 1 from third"
    assert said == ["two.arf", "a/one.rmf"]
    assert cache["a/one.rmf"].path.read_bytes() == b"hello"
    again = data.fetch(sources={"none": fails})
    assert again.summary() == "2 files, sha256 verified: 2 already there"


@pytest.mark.parametrize("damage", [b"hell", b"", b"hellO"])
def test_a_damaged_file_is_noticed_and_mended(cache, damage):
    data.fetch(sources={"s": gives(*cache)})
    cache["two.arf"].path.write_bytes(damage)
    assert data.fetch(["two.arf"], sources={"s": gives(*cache)}).origin == {"two.arf": "s"}
    assert cache["two.arf"].path.read_bytes() == b"hello"


def test_wrong_content_is_never_stored(cache):
    with pytest.raises(InputError, match=r"two\.arf.*gaugeblock data fetch"):
        data.fetch(sources={"liar": gives(*cache, content=b"goodbye")})
    assert not any(file.path.exists() for file in cache.values())
    assert not list(cache["two.arf"].path.parent.parent.rglob(".*"))


def test_nowhere_to_be_had_is_one_line_with_every_reason(cache):
    with pytest.raises(InputError) as caught:
        data.fetch(sources={"the site": fails, "PyPI": fails})
    assert str(caught.value) == (
        "data files missing: a/one.rmf, two.arf (the site: is on holiday; PyPI: is on holiday); "
        "run `gaugeblock data fetch` where there is a network"
    )


def test_a_cache_that_cannot_be_written_is_one_line(cache):
    cache["two.arf"].path.parent.write_text("a file where the folder should be")
    with pytest.raises(InputError, match=r"cannot write .*XDG_CACHE_HOME"):
        data.fetch(["two.arf"], sources={"s": gives("two.arf")})


def test_a_site_that_does_not_answer_costs_seconds_only(cache, monkeypatch):
    import requests

    monkeypatch.setattr(data, "PATIENCE", 0.2)
    ended = threading.Event()

    def silence(*_, **__):
        ended.wait(20)
        raise requests.ConnectionError

    monkeypatch.setattr(requests, "head", silence)
    began = time.monotonic()
    with pytest.raises(data.SourceError, match="no answer"):
        data.from_jaxspec_site(list(cache.values()), lambda _: None)
    assert time.monotonic() - began < 5
    ended.set()


def test_the_site_is_checked_by_hash_too(cache, monkeypatch):
    import requests

    class Answer:
        ok = True
        content = b"hello"

        def raise_for_status(self):
            pass

    monkeypatch.setattr(requests, "head", lambda *_, **__: Answer())
    monkeypatch.setattr(requests, "get", lambda *_, **__: Answer())
    data.from_jaxspec_site(list(cache.values()), lambda _: None)
    assert all(file.intact for file in cache.values())
    Answer.content = b"an error page"
    cache["two.arf"].path.unlink()
    Answer.ok = False
    with pytest.raises(data.SourceError, match="no answer"):
        data.from_jaxspec_site([cache["two.arf"]], lambda _: None)
    with pytest.raises(data.SourceError, match="does not have them"):
        data.from_jaxspec_site([replace(cache["two.arf"], url=None)], lambda _: None)
    Answer.ok = True
    with pytest.raises(data.SourceError, match="sha256 differs"):
        data.from_jaxspec_site([cache["two.arf"]], lambda _: None)


def pip(write=None, code=0, stderr=""):
    def run(command, **_):
        if write is not None:
            write(command[command.index("--dest") + 1])
        return subprocess.CompletedProcess(command, code, "", stderr)

    return run


def test_files_are_found_in_a_wheel_by_their_hash(cache, monkeypatch):
    def wheel(folder):
        with zipfile.ZipFile(f"{folder}/jaxspec-0.0.5-py3-none-any.whl", "w") as archive:
            archive.writestr("jaxspec/renamed.rmf", b"hello")
            archive.writestr("jaxspec/two.arf", b"another version")

    monkeypatch.setattr(data.subprocess, "run", pip(wheel))
    other = replace(cache["two.arf"], sha256="0" * 64)
    data.from_pypi([cache["a/one.rmf"], other], lambda _: None)
    assert cache["a/one.rmf"].intact
    assert not cache["two.arf"].path.exists()


def test_each_file_is_asked_of_its_own_wheel_with_the_pip_that_there_is(cache, monkeypatch):
    asked = []

    def run(command, **how):
        asked.append((command[0], command[-1]))
        # What pip says is no business of ours, and its failure an answer.
        assert (how["capture_output"], how["text"], how["check"]) == (True, True, False)
        if len(asked) > 2:
            raise subprocess.TimeoutExpired(command, how["timeout"])
        with zipfile.ZipFile(f"{command[command.index('--dest') + 1]}/a.whl", "w") as archive:
            archive.writestr("one.rmf", b"hello")

    def ran(command, **how):
        run(command, **how)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(data.subprocess, "run", ran)
    nicer = replace(cache["a/one.rmf"], name="nicer.rmf")
    data.from_pypi([nicer], lambda _: None)
    data.from_pypi([cache["a/one.rmf"]], lambda _: None)
    assert asked == [(data.sys.executable, data.NICER_WHEEL), (data.sys.executable, data.JAXSPEC_WHEEL)]
    monkeypatch.setattr(data.metadata, "distributions", lambda **_: iter(()))
    for there, used in (({"pip"}, "pip"), ({"pip", "pip3"}, "pip3")):
        monkeypatch.setattr(data.shutil, "which", lambda name, there=there: name if name in there else None)
        with pytest.raises(data.SourceError, match=r"could not download .* \(TimeoutExpired\)"):
            data.from_pypi([nicer], lambda _: None)
        assert asked[-1] == (used, data.NICER_WHEEL)


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (
            pip(code=1, stderr="ERROR: y\nERROR: No matching distribution\nWARNING: x\n"),
            "ERROR: No matching distribution",
        ),
        (pip(), "no reason given"),
        (
            pip(lambda folder: open(f"{folder}/jaxspec-0.0.5-py3-none-any.whl", "wb").close()),
            "jaxspec-0.0.5-py3-none-any.whl is damaged",
        ),
    ],
)
def test_a_wheel_that_cannot_be_had_is_a_reason(cache, monkeypatch, run, words):
    monkeypatch.setattr(data.subprocess, "run", run)
    with pytest.raises(data.SourceError, match=words):
        data.from_pypi(list(cache.values()), lambda _: None)


def test_without_pip_it_says_how_to_get_it(cache, monkeypatch):
    monkeypatch.setattr(data.metadata, "distributions", lambda **_: iter(()))
    monkeypatch.setattr(data.shutil, "which", lambda _: None)
    with pytest.raises(data.SourceError, match="python -m ensurepip"):
        data.from_pypi(list(cache.values()), lambda _: None)


def test_jaxspecs_own_files_go_where_jaxspec_looks():
    from jaxspec.util.online_storage import table_manager

    known = data.files()
    assert set(known) == (set(table_manager.registry) - set(data.NOT_NEEDED)) | set(data.NICER_FILES)
    for name in set(known) - set(data.NICER_FILES):
        assert known[name].path == data.Path(table_manager.path) / name
        assert table_manager.registry[name] == f"sha256:{known[name].sha256}"


def test_reference_says_how_to_get_a_missing_file(cache, monkeypatch):
    from gaugeblock.simulators.xray import reference

    wanted = {
        data.EXAMPLE + name: cache["two.arf"] for name in ("PN.rmf", "PN.arf", "PN_spectrum_grp20.fits")
    }
    monkeypatch.setattr(data, "files", lambda: wanted)
    monkeypatch.setattr(data, "from_jaxspec_site", fails)
    monkeypatch.setattr(data, "from_pypi", fails)
    with pytest.raises(InputError, match="gaugeblock data fetch"):
        reference()


def test_first_use_fetches_what_comes_together_at_once_and_says_so(cache, monkeypatch, caplog):
    calls = []
    # Those of another wheel stay where they are.
    name = next(iter(data.NICER_FILES))
    cache[name] = replace(cache["two.arf"], name=name, path=cache["two.arf"].path.with_name(name))

    def source(wanted, progress):
        calls.append([file.name for file in wanted])
        gives(*cache)(wanted, progress)

    monkeypatch.setattr(data, "from_jaxspec_site", source)
    assert data.path("two.arf").read_bytes() == b"hello"
    assert data.path("a/one.rmf").read_bytes() == b"hello"
    assert calls == [["a/one.rmf", "two.arf"]]
    assert [record.levelname for record in caplog.records] == ["WARNING", "WARNING"]


def test_a_companion_that_cannot_be_had_does_no_harm(cache, monkeypatch):
    monkeypatch.setattr(data, "from_jaxspec_site", gives("two.arf"))
    monkeypatch.setattr(data, "from_pypi", fails)
    assert data.path("two.arf").read_bytes() == b"hello"
    with pytest.raises(InputError, match=r"a/one\.rmf"):
        data.path("a/one.rmf")


def test_everything_can_be_fetched(xray_data):
    assert set(xray_data.origin) == set(data.files())
    assert all(file.intact for file in data.files().values())
