"""Which pools the study has, and how large they are."""

from __future__ import annotations

from studies.gain.pools import Pool

SEED = 20260611


def pools(*, share: float = 1.0) -> dict[str, Pool]:
    """All pools by name; `share` makes them smaller, for tests."""

    def n(number: int) -> int:
        return max(2, round(number * share))

    found = [
        Pool("bright", "", 0.0, n(10_000)),
        *(Pool("bright", "published_gain", value, n(10_000)) for value in (1.03, 0.97)),
        *(Pool("bright", "gain_slope", value, n(5_000)) for value in (1.03, 0.97)),
        Pool("medium", "", 0.0, n(10_000), n(10_000)),
        *(Pool("medium", "published_gain", value, n(10_000), n(4_000)) for value in (1.03, 0.97)),
        *(Pool("medium", "gain_slope", value, n(5_000)) for value in (1.03, 0.97)),
        Pool("bright", "", 0.0, n(20_000), integration="exact", small=True),
        *(
            Pool("bright", name, value, n(5_000), integration="exact", small=True)
            for name in ("published_gain", "gain_slope")
            for value in (1.003, 0.997)
        ),
    ]
    return {pool.name: pool for pool in found}
