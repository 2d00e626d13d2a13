"""Small audits of an exact, a narrow and a samples-only Gaussian toy, with the real validators and judge."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from gaugeblock.validate import Finding, Verdict, make_trials, trials_tree
from gaugeblock.validate.judging import judge
from gaugeblock.validate.policy import read_policy
from gaugeblock.validate.validators import run_validators

HOSTILE = "<script>alert('x')</script>&\"|`*_[a](b)"


@dataclass(frozen=True)
class Audit:
    verdict: Verdict
    findings: tuple[Finding, ...]
    trials: xr.DataTree


def gaussian_trials(
    *,
    n: int = 3000,
    draws: int = 100,
    width: float = 1.0,
    densities: bool = True,
    names: tuple[str, ...] = ("alpha", "beta"),
) -> xr.DataTree:
    """theta ~ N(0, 1), x ~ N(theta, 0.5): draws of the posterior N(0.8 x, 0.2), `width` times as wide."""
    rng = np.random.default_rng(11)
    dims = len(names)
    theta = rng.normal(size=(n, dims))
    x = theta + 0.5 * rng.normal(size=(n, dims))
    sd = width * np.sqrt(0.2)

    def sampled(first: int, size: int) -> xr.Dataset:
        noise = rng.normal(size=(first, size, dims))
        theta_drawn = 0.8 * x[:first, None] + sd * noise
        half_log = 0.5 * np.log(2 * np.pi)
        logs = {
            "log_q": (-0.5 * noise**2 - np.log(sd) - half_log).sum(-1),
            "log_prior": (-0.5 * theta_drawn**2 - half_log).sum(-1),
            "log_likelihood": (-2 * (x[:first, None] - theta_drawn) ** 2 - np.log(0.5) - half_log).sum(-1),
        }
        return make_trials(theta[:first], theta_drawn, names, **(logs if densities else {}))

    return trials_tree(sampled(n, draws), sampled(100, 200)) if densities else trials_tree(sampled(n, draws))


def audited(trials: xr.DataTree, *, policy: str = "default") -> Audit:
    findings, not_checked = run_validators(trials, seed=5)
    verdict = judge(findings, not_checked, read_policy(policy), seed=5)
    provenance = {
        "started": "2026-01-02T03:04:05Z",
        "seed": 5,
        "versions": {"gaugeblock": "0.1.0"},
        "sha256": {"policy": "ab" * 32},
        "command": f"gaugeblock audit --note {HOSTILE}",
        "policy": "error_budget = 0.05\n[tolerance]\nbias = 0.1\n",
        "not a number": float("nan"),
        "nothing": None,
    }
    return Audit(replace(verdict, provenance=provenance), findings, trials)


@pytest.fixture(scope="session")
def passing() -> Audit:
    return audited(gaussian_trials())


@pytest.fixture(scope="session")
def failing() -> Audit:
    """Posteriors 0.7 times as wide as they should be, and a parameter with a hostile name."""
    return audited(gaussian_trials(width=0.7, names=(HOSTILE, "beta")))


@pytest.fixture(scope="session")
def undecided() -> Audit:
    """Too few trials, no densities where the policy requires them."""
    return audited(gaussian_trials(n=60, densities=False), policy="strict")


@pytest.fixture(params=["passing", "failing", "undecided"])
def audit(request: pytest.FixtureRequest) -> Audit:
    chosen: Audit = request.getfixturevalue(request.param)
    return chosen


@pytest.fixture(scope="session")
def make_audit() -> Callable[..., Audit]:
    """`make_audit(policy=..., **gaussian_trials options)`, for audits of one test alone."""
    return lambda *, policy="default", **options: audited(gaussian_trials(**options), policy=policy)


FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-dev-shm-usage",
    "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-extensions",
    "--hide-scrollbars", "--enable-logging=stderr", "--v=0", "--virtual-time-budget=2000",
]  # fmt: skip

# Measures the page and writes what it found into it; runs in a test's copy, from which the policy that
# forbids every script has been taken out.
PROBE = """<script>
addEventListener("load", () => {
  document.querySelectorAll("details").forEach(fold => { fold.open = true; });
  const boxes = [...document.querySelectorAll("svg")].map(svg => {
    const box = svg.getBoundingClientRect();
    return [svg.getAttribute("class") || "key", box.width, box.height];
  });
  const texts = [...document.querySelectorAll("svg.chart")].flatMap(svg => {
    const frame = svg.getBoundingClientRect();
    return [...svg.querySelectorAll("text")].filter(text => {
      const box = text.getBoundingClientRect();
      return box.left < frame.left - 1 || box.right > frame.right + 1 || box.bottom > frame.bottom + 1;
    }).map(text => text.textContent);
  });
  const onEachOther = [...document.querySelectorAll("svg.chart")].flatMap(svg => {
    const seen = [...svg.querySelectorAll("text")].filter(
      text => text.textContent.trim() && getComputedStyle(text).visibility !== "hidden"
    ).map(text => [text.textContent, text.getBoundingClientRect()]);
    return seen.flatMap(([one, a], place) => seen.slice(0, place).filter(([, b]) =>
      Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 &&
      Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 3
    ).map(([other]) => [one, other]));
  });
  const word = document.querySelector(".verdict .word");
  const found = {
    boxes, cutOff: texts, onEachOther,
    width: innerWidth, content: document.documentElement.scrollWidth,
    fetched: performance.getEntriesByType("resource").map(entry => entry.name),
    wordSize: parseFloat(getComputedStyle(word).fontSize),
    wordTop: word.getBoundingClientRect().top,
    ground: getComputedStyle(document.body).backgroundColor,
  };
  const place = document.createElement("pre");
  place.id = "measured";
  place.textContent = JSON.stringify(found);
  document.body.append(place);
});
</script>"""


@dataclass(frozen=True)
class Visit:
    dom: str
    log: str

    @property
    def complaints(self) -> list[str]:
        """Lines of the page's console, errors and refusals included."""
        return [line for line in self.log.splitlines() if "CONSOLE" in line]

    @property
    def measured(self) -> dict:
        found = re.search(r'<pre id="measured">(.*?)</pre>', self.dom, flags=re.DOTALL)
        assert found, "the probe did not run"
        return json.loads(html.unescape(found.group(1)))


@pytest.fixture(scope="session")
def chromium(
    missing: Callable[[str], None], tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Visit]:
    program = next(
        (p for p in map(shutil.which, ("chromium", "google-chrome", "chromium-browser")) if p), None
    )
    if program is None:
        missing("neither chromium nor google-chrome is on the PATH (Debian: apt-get install chromium)")
    profile = tmp_path_factory.mktemp("profile")

    def visit(page: Path, *flags: str) -> Visit:
        done = subprocess.run(
            [str(program), *FLAGS, f"--user-data-dir={profile}", *flags, page.as_uri()],
            capture_output=True, text=True, errors="replace", timeout=120, check=False,
            env={**os.environ, "LC_ALL": "C.UTF-8"},
        )  # fmt: skip
        return Visit(done.stdout, done.stderr)

    return visit


@pytest.fixture(scope="session")
def probed() -> Callable[[Path], Path]:
    """`probed(page)`: a copy of the page that measures itself."""

    def probe(page: Path) -> Path:
        text, taken = re.subn(r'<meta http-equiv="Content-Security-Policy"[^>]*>', PROBE, page.read_text())
        assert taken == 1
        copy = page.with_name("probed.html")
        copy.write_text(text)
        return copy

    return probe


# Frames, for Chromium's window is never narrower than 500 pixels; each says what it measured.
WIDTHS = (1200, 500, 390)
PASS_ON = """
addEventListener("load", () => parent.postMessage(
  [window.name, document.getElementById("measured").textContent], "*"));
</script>"""
HOLDER = """<!DOCTYPE html><title>frames</title><body style="margin:0">
<script>const said = {};
addEventListener("message", ({data: [name, text]}) => {
  said[name] = JSON.parse(text);
  if (Object.keys(said).length < document.querySelectorAll("iframe").length) return;
  const place = document.createElement("pre");
  place.id = "measured"; place.textContent = JSON.stringify(said); document.body.append(place);
});</script>"""
FRAME = '<iframe name="{name}" src="{name}.html" style="width:{width}px;height:900px;border:0"></iframe>'
ON_EACH_OTHER = """<svg class="chart" width="90" height="20">
<text y="12">one</text><text y="14">two</text></svg></main>"""


@pytest.fixture(scope="session")
def framed(probed: Callable[[Path], Path]) -> Callable[..., Path]:
    """`framed(page, name=text)`: this page at each width, with labels on each other, and others, in frames.

    What each `measured` says stands in what the whole measures, under its width, `labels` or its name.
    """

    def frame(page: Path, **others: str) -> Path:
        text = probed(page).read_text()
        plain = {str(width): text for width in WIDTHS}
        texts = plain | {"labels": text.replace("</main>", ON_EACH_OTHER)} | others
        holder = page.with_name("holder.html")
        lines = [HOLDER]
        for name, content in texts.items():
            page.with_name(f"{name}.html").write_text(content.replace("</script>", PASS_ON, 1))
            lines.append(FRAME.format(name=name, width=name if name in plain else WIDTHS[0]))
        holder.write_text("\n".join(lines))
        return holder

    return frame


@pytest.fixture(scope="session")
def brightness() -> Callable[[dict[str, str]], int]:
    """Of what a page measured of itself: red, green and blue of its ground, together."""
    return lambda measured: sum(map(int, re.findall(r"\d+", measured["ground"])[:3]))


# Python packages that carry axe's script, the newest first.
CARRIERS = ("axe_playwright_python", "axe_core_python")
RUN = """
addEventListener("load", async () => {
  document.querySelectorAll("details").forEach(fold => { fold.open = true; });
  const found = await axe.run(document, {resultTypes: ["violations", "passes"]});
  const place = document.createElement("pre");
  place.id = "measured";
  place.textContent = JSON.stringify({
    passed: found.passes.length,
    violations: found.violations.map(one => [one.id, one.nodes.length, one.nodes[0].html.slice(0, 200)]),
  });
  document.body.append(place);
});
"""


@pytest.fixture(scope="session")
def axe(missing: Callable[[str], None]) -> str | None:
    for name in CARRIERS:
        spec = find_spec(name)
        path = Path(str(spec.origin)).with_name("axe.min.js") if spec is not None else None
        if path is not None and path.is_file():
            return path.read_text()
    return missing("axe-core is not installed: pip install axe-core-python")


@pytest.fixture(scope="session")
def violations(axe: str, chromium: Callable[..., Visit]) -> Callable[..., list]:
    """`violations(page)`: what axe-core finds wrong with a page when all of it is open."""

    def judged(page: Path, *flags: str) -> list:
        text, taken = re.subn(
            r'<meta http-equiv="Content-Security-Policy"[^>]*>|(?=</head>)',
            lambda _: f"<script>{axe}</script><script>{RUN}</script>",
            page.read_text(),
            count=1,
        )
        assert taken == 1
        copy = page.with_name("judged.html")
        copy.write_text(text)
        found = chromium(copy, "--dump-dom", "--virtual-time-budget=60000", *flags).measured
        copy.unlink()
        assert found["passed"] > 20, "axe did not run"
        return found["violations"]

    return judged
