"""Pictures of the report, at the widths of a phone, a tablet and a desk, in light and in dark.

    python docs/_site/report_pictures.py

It audits a toy whose second parameter is 0.6 times as wide as it should be, and looks at it with Chromium.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import gaugeblock

DOCS = Path(__file__).parents[1]
SIZES = {390: 1500, 820: 1180, 1280: 900}
ROOMS = {"light": [], "dark": ["--blink-settings=preferredColorScheme=0"]}
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
         "--disable-background-networking", "--disable-component-update", "--hide-scrollbars",
         "--allow-file-access-from-files", "--virtual-time-budget=4000")  # fmt: skip
# A window of Chromium is never narrower than this; a frame in it can be.
NARROWEST = 500
COLOURS = 96


def example(folder: Path) -> Path:
    """The report of a narrow toy."""
    rng = np.random.default_rng(3)
    names = ["tbabs_1.nh", "powerlaw_1.alpha", "blackbodyrad_1.kT"]
    prior, noise = np.array([0.3, 0.5, 0.2]), np.array([0.1, 0.2, 0.05])
    theta = [1.0, 2.0, 0.8] + prior * rng.normal(size=(3000, 3))
    x = theta + noise * rng.normal(size=theta.shape)
    variance = 1 / (1 / prior**2 + 1 / noise**2)
    mean = variance * (x / noise**2 + np.array([1.0, 2.0, 0.8]) / prior**2)
    width = np.sqrt(variance) * [1.0, 0.6, 1.0]
    draws = mean[:, None] + width * rng.normal(size=(3000, 200, 3))
    found = gaugeblock.audit_draws(theta, draws, x=x, names=names)
    record = dict(found.verdict.provenance) | {"title": "A toy with one parameter too narrow"}
    replace(found, verdict=replace(found.verdict, provenance=record)).save(folder)
    return folder / "report.html"


def picture(chromium: str, page: Path, width: int, room: str, out: Path) -> None:
    """The top of a page as a small PNG."""
    height = SIZES[width]
    holder = page.with_name("holder.html")
    holder.write_text(
        f'<!DOCTYPE html><body style="margin:0"><iframe src="{page.name}" '
        f'style="width:{width}px;height:{height}px;border:0"></iframe></body>'
    )
    raw = page.with_name("raw.png")
    size = f"--window-size={max(width, NARROWEST)},{height}"
    command = [chromium, *FLAGS, *ROOMS[room], size, f"--screenshot={raw}", holder.as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    with Image.open(raw) as seen:
        seen.convert("RGB").crop((0, 0, width, height)).quantize(COLOURS).save(out, optimize=True)


def main() -> None:
    """All pictures, and the one that the README shows."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        raise SystemExit("there is no Chromium here (Debian: apt-get install chromium)")
    with tempfile.TemporaryDirectory() as temporary:
        page = example(Path(temporary) / "audit")
        for width in SIZES:
            for room in ROOMS:
                picture(chromium, page, width, room, DOCS / "figures" / f"report-{width}-{room}.png")
    shutil.copy(DOCS / "figures" / "report-1280-light.png", DOCS / "report.png")


if __name__ == "__main__":
    main()
