"""docs/trust.md holds a row for each attack that is tested here, made from the tests."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BEGIN, END = "<!-- attacks: from tests/trust -->\n", "<!-- attacks end -->\n"
ROOMS = {
    "test_files.py": "files",
    "test_fuzz.py": "files",
    "test_configurations.py": "configurations",
    "test_action.py": "the action",
    "test_estimators.py": "estimators",
    "test_records.py": "records",
    "test_marks.py": "records",
    "test_rerun.py": "records",
    "test_commitments.py": "records",
    "test_statements.py": "records",
    "test_faults.py": "the machine",
    "test_kills.py": "the machine",
}


def rows() -> list[tuple[str, str, str]]:
    found = []
    for name, room in ROOMS.items():
        tree = ast.parse((Path(__file__).parent / name).read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "pytest.mark.attack":
                what, outcome = (ast.literal_eval(argument) for argument in node.args)
                found.append((room, what, outcome))
    return found


def table() -> str:
    head = "| handed in | attack | outcome |\n|---|---|---|\n"
    return head + "".join(f"| {room} | {what} | {outcome} |\n" for room, what, outcome in rows())


def test_every_attack_is_on_the_page() -> None:
    page = (ROOT / "docs" / "trust.md").read_text(encoding="utf-8")
    written = page.partition(BEGIN)[2].partition(END)[0]
    assert written == table(), "make it anew: python tests/trust/test_page.py"
    assert len(rows()) >= 25
    assert not set(Path(__file__).parent.glob("test_*.py")) - {
        Path(__file__).parent / name for name in (*ROOMS, "test_page.py", "test_boundary.py")
    }


if __name__ == "__main__":
    path = ROOT / "docs" / "trust.md"
    before, _, rest = path.read_text(encoding="utf-8").partition(BEGIN)
    path.write_text(before + BEGIN + table() + END + rest.partition(END)[2], encoding="utf-8")
