"""What a check found, to look at: in a terminal or a notebook, as a table, as pictures, as files."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gaugeblock.auditing.ways_on import Doubting, Narrowed, doubting, narrowed
from gaugeblock.core.atomic import made_folder, write_atomically
from gaugeblock.core.errors import InputError
from gaugeblock.core.values import Value
from gaugeblock.reports.check import PICTURES, check_card, check_html, check_lines, draw_check
from gaugeblock.validate import Outcome
from gaugeblock.validate.observation.answer import Answer

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Check(Value):
    """The answer of `gaugeblock.check`, with where it comes from."""

    answer: Answer
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def outcome(self) -> Outcome:
        """PASS, FAIL or INCONCLUSIVE; equal to these words."""
        return self.answer.outcome

    @property
    def passed(self) -> bool:
        """Whether it could, and the check would have seen what it must."""
        return self.outcome is Outcome.PASS

    @property
    def p_value(self) -> float:
        """Over all views at once: at most alpha in a share alpha of what the simulator did make."""
        return self.answer.p_value

    @property
    def named(self) -> str | None:
        """The generic effect that explains the disagreement best, where one does."""
        return self.answer.alike[0].name if self.answer.alike else None

    @property
    def lines(self) -> tuple[str, ...]:
        """The verdict, then where, what it looks like, or what would have been seen."""
        return tuple(check_lines(self.answer))

    def __bool__(self) -> bool:
        raise InputError(
            'a check is neither true nor false: ask for result.passed, or result.outcome == "FAIL"'
        )

    def to_frame(self) -> pd.DataFrame:
        """One row a view, by its name: p-values, alone and for that there are several; what it looks at."""
        import pandas as pd

        rows = [asdict(view) for view in self.answer.views]
        return pd.DataFrame(rows, columns=["name", "p_value", "p_adjusted", "says"]).set_index("name")

    def plot(self, what: str = "where", *, ax: Axes | None = None) -> Axes:
        """A picture, ``"where"``, ``"views"`` or ``"would_see"``, on `ax` or on new axes.

        Raises
        ------
        InputError
            If there is no such picture.
        MissingExtraError
            Without matplotlib.
        """
        if what not in PICTURES:
            raise InputError(f"no picture {what!r} of a check; there are {', '.join(PICTURES)}")
        return draw_check(self.answer, what, ax=ax)

    def to_json(self) -> dict[str, Any]:
        """What check.json holds."""
        return {**self.answer.to_json(), "text": "; ".join(self.lines), "provenance": self.provenance}

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write check.json and report.html into a folder, made where missing.

        Raises
        ------
        InputError
            If the folder cannot be made or written to.
        """
        made = made_folder(folder)
        content = json.dumps(self.to_json(), indent=2, sort_keys=True, allow_nan=False, ensure_ascii=False)
        write_atomically(made / "check.json", content + "\n")
        write_atomically(
            made / "report.html", check_html(self.answer, self.provenance).encode("utf-8", "replace")
        )
        return made

    def without(self, simulator: Any, *, prior: Any = None) -> Narrowed:
        """The simulator without the places that disagree, to retrain and to audit; ``.of(x)`` of data.

        Raises
        ------
        InputError
            If no place of the data disagrees, or none would be left.
        """
        return narrowed(simulator, self.answer, prior=prior)

    @staticmethod
    def doubting(simulator: Any, *, prior: Any = None, noise: Any = None) -> Doubting:
        """The simulator with extra noise as a last parameter, of prior `noise`, to retrain and audit."""
        return doubting(simulator, prior=prior, noise=noise)

    def __repr__(self) -> str:
        first, *lines = self.lines
        return "\n  ".join([f"<Check {first}>", *lines])

    def _repr_html_(self) -> str:
        return check_card(self.answer, self.provenance)
