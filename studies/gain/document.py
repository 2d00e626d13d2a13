"""Tables and figure of ``docs/gain.md``, made of the stored results."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from gaugeblock.core.atomic import write_atomically
from gaugeblock.reports.discovery.gain import gain_headline
from studies.gain.table import THRESHOLD, spread
from studies.kit.page import fill
from studies.kit.page import table as rows
from studies.kit.results import command_of, read

SMALL, FIVE = 0.003, 5.0
"""An amplitude, and standard errors that make it certain."""

OURS = {
    "alone": "shared score",
    "offset and area": "shared score, offset and area free",
    "marginal": "marginal score",
}


def headline(sums: xr.Dataset, beside: xr.Dataset) -> xr.Dataset:
    """What the headline figure shows: dims ``scheme, case``, the published form of the gain alone."""
    labels = [case for case in beside["case"].values.tolist() if "published" in case]
    parts = []
    for label in labels:
        lines = []
        for scheme in beside["scheme"].values.tolist():
            value, low, high = (
                float(beside[k].sel(case=label, scheme=scheme)) for k in ("value", "null_low", "null_high")
            )
            middle, sd = 0.5 * (low + high), (high - low) / (2 * 1.96)
            # An AUC below the centre is as telling as one above: the side is of no matter.
            lines.append((middle + abs(value - middle), low, high, middle + THRESHOLD * sd))
        for statistic in OURS:
            lines.append(_own(sums, label, statistic))
        parts.append(np.array(lines))
    names = [*beside["scheme"].values.tolist(), *OURS.values()]
    values = np.stack(parts, axis=1)
    return xr.Dataset(
        {
            name: (("scheme", "case"), values[..., k])
            for k, name in enumerate(("value", "null_low", "null_high", "threshold"))
        },
        coords={"scheme": names, "case": labels},
        attrs={
            "title": "A gain shift of 3 per cent",
            "x_label": f"distance from effect-free data over the threshold ({THRESHOLD:g} of their sd)",
        },
    )


def _own(sums: xr.Dataset, label: str, statistic: str) -> tuple[float, float, float, float]:
    cell = _cell(sums, label, statistic)
    if cell is None:
        return (np.nan,) * 4
    mean, sd = cell["null_mean"], cell["null_sd"]
    return mean + abs(cell["z"] - mean), mean - 1.96 * sd, mean + 1.96 * sd, mean + THRESHOLD * sd


def _cell(sums: xr.Dataset, label: str, statistic: str) -> dict[str, float] | None:
    """What is known of a statistic of a case's catalogues, if anything is."""
    if label not in sums["case"].values or statistic not in sums["statistic"].values:
        return None
    cell = {str(name): float(sums[name].sel(case=label, statistic=statistic)) for name in sums}
    cell["null_sd"] = spread(cell["null_sd"], cell["null_mean_error"] ** 2)
    return cell if np.isfinite(cell["z"]) else None


def schemes_table(beside: xr.Dataset, sums: xr.Dataset | None = None) -> str:
    """Scheme, null and what each case reads; our statistics too, where `sums` has them."""
    labels = beside["case"].values.tolist()
    lines: list[tuple[str, ...]] = []
    for scheme in beside["scheme"].values.tolist():
        part = beside.sel(scheme=scheme)
        low, high = (float(part[k].values[0]) for k in ("null_low", "null_high"))
        digits = 2 if scheme != "paired evidence" else 1
        lines.append(
            (scheme, f"{low:.{digits}f} to {high:.{digits}f}")
            + tuple(f"{float(v):.{digits}f}" for v in part["value"].values)
        )
    for statistic, name in OURS.items() if sums is not None else ():
        known = [_cell(sums, label, statistic) for label in labels]
        nulls = [f"{cell['null_low']:+.1f} to {cell['null_high']:+.1f}" for cell in known if cell]
        cells = [f"**{cell['z']:+.1f}**" if cell else "" for cell in known]
        lines.append((name, nulls[-1] if nulls else "", *cells))
    return rows(("scheme", "effect-free", *labels), lines)


def catalogues_table(sums: xr.Dataset) -> str:
    """z and amplitude of every case and set of nuisances."""
    lines: list[tuple[str, ...]] = []
    for label in sums["case"].values.tolist():
        for statistic in sums["statistic"].values.tolist():
            cell = _cell(sums, label, statistic)
            if cell is None:
                continue
            lines.append(
                (
                    label,
                    statistic,
                    f"{cell['z']:+.1f} ({cell['z_mean']:+.1f})",
                    f"{cell['null_mean']:+.2f} ± {cell['null_sd']:.2f}",
                    f"{(cell['z_mean'] - cell['null_mean']) / cell['null_sd']:+.1f}",
                    f"{cell['null_largest']:.1f}",
                    f"{100 * cell['amplitude']:+.3f} ± {100 * cell['standard_error']:.3f}",
                    f"{100 * cell['amplitude_mean']:+.3f}",
                    f"{100 * cell['power']:.0f}%",
                )
            )
    header = (
        "catalogue",
        "beside",
        "z (mean)",
        "z, effect-free",
        "mean z from there, sd",
        "largest",
        "one step, %",
        "mean of steps, %",
        "seen",
    )
    return rows(header, lines)


def profiles_table(profiles: xr.Dataset) -> str:
    """Profiled amplitudes of every case's catalogues, and how many 90% intervals hold the truth."""
    found: dict[str, list[dict[str, float]]] = {}
    for label in profiles["case"].values.tolist():
        cell = {str(name): float(profiles[name].sel(case=label)) for name in profiles}
        found.setdefault(label.rpartition(", catalogue")[0], []).append(cell)
    lines: list[tuple[str, ...]] = []
    for case, cells in found.items():
        held = sum(cell["low"] < cell["truth"] < cell["high"] for cell in cells)
        values = ", ".join(f"{100 * cell['value']:+.2f}" for cell in cells)
        error = 100 * float(np.mean([cell["standard_error"] for cell in cells]))
        lines.append((case, values, f"{error:.3f}", f"{held} of {len(cells)}"))
    header = (
        "catalogues",
        "profiled amplitudes, %",
        "standard error, %",
        "truth in the 90% interval",
    )
    return rows(header, lines)


def marginal_table(marginal: xr.Dataset) -> str:
    """Marginal scores with the population fitted."""
    lines: list[tuple[str, ...]] = [
        (
            label,
            f"{float(marginal['z'].sel(case=label)):+.1f}",
            f"{100 * float(marginal['amplitude'].sel(case=label)):+.2f} ± "
            f"{100 * float(marginal['standard_error'].sel(case=label)):.2f}",
        )
        for label in marginal["case"].values.tolist()
    ]
    return rows(("catalogue", "z, population fitted", "one step, %"), lines)


def limits_table(limits: xr.Dataset) -> str:
    """Standard errors against the number of bright sources, and floors, all in per cent."""
    numbers = limits["number"].values.tolist()
    lines: list[tuple[str, ...]] = []
    for gain in limits["gain"].values.tolist():
        part = limits.sel(gain=gain)
        for kind, words, floor in (
            ("alone", "alone", f"{100 * float(part['floor']):.3f}"),
            ("beside", "beside offset and area", "0"),
        ):
            errors = (f"{100 * float(v):.3f}" for v in part[kind].values)
            lines.append((gain.replace("_", " "), words, *errors, floor))
    header = ("gain", "", *(f"{n:,} bright" for n in numbers), "floor, area off by 1%")
    needed = " and ".join(
        f"{float(f'{sources_needed(limits.sel(gain=gain)):.2g}'):,.0f} ({gain.replace('_', ' ')})"
        for gain in limits["gain"].values.tolist()
    )
    said = (
        f"An amplitude of {SMALL:.1%} is {FIVE:g} standard errors beside offset and area from some {needed} "
        "bright sources on."
    )
    return rows(header, lines) + "\n\n" + said


def sources_needed(limits: xr.Dataset) -> float:
    """From how many sources on a small amplitude is five errors beside offset and area; between the numbers
    of the table errors fall as a power.
    """
    number, error = limits["number"].values, limits["beside"].values
    return float(np.exp(np.interp(np.log(FIVE / SMALL), -np.log(error), np.log(number))))


def document(path: Path, docs: Path) -> None:
    """Draw the figure and fill in the tables."""
    names = ("", "profiles", "marginal", "schemes", "limits", "headline")
    groups = {name: read(path, name) for name in names}
    tables = {
        "schemes": schemes_table(groups["schemes"], groups[""]),
        "catalogues": catalogues_table(groups[""]),
        "profiles": profiles_table(groups["profiles"]),
        "marginal": marginal_table(groups["marginal"]),
        "limits": limits_table(groups["limits"]),
        "made": f"Made by `{command_of(groups[''])}`, seed {groups[''].attrs['seed']}.",
    }
    fill(docs / "gain.md", tables)
    (docs / "figures").mkdir(exist_ok=True)
    write_atomically(docs / "figures" / "gain.svg", str(gain_headline(groups["headline"])) + "\n")
