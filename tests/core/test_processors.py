import platform
import re
from pathlib import Path

import pytest

from gaugeblock.core import processors
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.processors import kinds, one_kind, processor


def test_a_processor_says_what_it_is() -> None:
    assert re.fullmatch(r"\w+ .+, vectors [0-9a-f]{8} \((cpu|gpu|cuda|tpu)\)", processor())
    assert processor() == processor()


def test_vector_instructions_and_device_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    table = "model name : Chip 9\nflags : fpu {} sse2 avx\nmodel name : Chip 9\n"
    found = []
    for extra in ("tsc", "avx512f", "fma"):
        processors._chip.cache_clear()
        monkeypatch.setattr(Path, "read_text", lambda *_, extra=extra, **__: table.format(extra))
        found.append(processor())
    monkeypatch.setattr(processors, "device_kinds", lambda flows: ["gpu"])
    found.append(processor())
    processors._chip.cache_clear()
    assert len(set(found)) == 4
    assert all("Chip 9" in name for name in found)
    assert found[-1].endswith("(gpu)")


@pytest.mark.parametrize(
    ("table", "name", "flags"),
    [
        (
            "model name\t: Chip 9: fast\nflags\t\t: sse4_1 fpu avx2 fma avx sse2 amx_tile\n",
            *("Chip 9: fast", ["amx_tile", "avx", "avx2", "fma", "sse4_1"]),
        ),
        ("processor : 0\nFeatures : fp asimdhp sve asimd xavx\n", "own", ["asimd", "asimdhp", "sve"]),
        (None, "own", []),
        (None, "", []),
    ],
)
def test_a_chip_is_its_name_and_its_vector_instructions_in_any_order(
    table: str | None, name: str, flags: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def read(*_: object, **__: object) -> str:
        if table is None:
            raise FileNotFoundError
        return table

    processors._chip.cache_clear()
    monkeypatch.setattr(Path, "read_text", read)
    monkeypatch.setattr(platform, "processor", lambda: name)
    monkeypatch.setattr(processors, "device_kinds", lambda flows: ["cpu"])
    found = processor()
    processors._chip.cache_clear()
    assert found == f"{platform.machine()} {name or 'unknown'}, vectors {digest(flags)[:8]} (cpu)"


def on(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(processors, "processor", lambda: name)


def test_another_kind_is_refused_by_name_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert kinds(tmp_path) == []
    on(monkeypatch, "Chip A")
    one_kind(tmp_path)
    one_kind(tmp_path)
    on(monkeypatch, "Chip B")
    with pytest.raises(InputError, match=r"was made on Chip A, and \S+ is Chip B.*--allow-mixed"):
        one_kind(tmp_path)
    assert kinds(tmp_path) == ["Chip A"]


def test_mixed_kinds_are_all_known_and_stay_mixed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("Chip A", "Chip B", "Chip C", "Chip A", "Chip B"):
        on(monkeypatch, name)
        one_kind(tmp_path, mixed=True)
    found = kinds(tmp_path, mixed=True)
    assert found[0] == "Chip A"
    assert sorted(found) == ["Chip A", "Chip B", "Chip C"]
    with pytest.raises(InputError, match="made on Chip A and on Chip"):
        kinds(tmp_path)


def test_a_damaged_record_is_told(tmp_path: Path) -> None:
    (tmp_path / processors.FIRST).write_bytes(b"{")
    with pytest.raises(InputError, match=r"processor.json cannot be read"):
        one_kind(tmp_path)
