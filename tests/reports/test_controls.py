"""What would have been caught, in words and as pictures: the fault that shows least stands for its kind."""

import re
from dataclasses import replace

from gaugeblock.reports.controls import by_kind, caught, controls_sections
from gaugeblock.reports.summary import summary_markdown
from gaugeblock.reports.terminal import terminal_summary
from gaugeblock.validate.verdict import Control


def control(kind, parameter, size, *, seen=True, tolerance=None):
    rungs = ((size / 2, False), (size, seen))
    return Control(
        kind=kind, parameter=parameter, size=size, unit="half-widths", caught=seen, text=f"a fault of {size}",
        power=0.8, tolerance=tolerance, rungs=rungs,
    )  # fmt: skip


CONTROLS = (
    control("bias", "a", 0.2, tolerance=0.1),
    control("bias", "b", 0.3, tolerance=0.1),
    control("region", "a", 0.9),
    control("region", "b", 0.5, seen=False),
    control("loss", "", 0.02),
)


def test_the_fault_that_shows_least_is_named(passing):
    verdict = replace(passing.verdict, controls=CONTROLS)
    assert [one.parameter for one in by_kind(verdict)["bias"]] == ["b", "a"]
    assert caught(verdict) == [
        "This audit would have caught, 80% of the time and on these shapes:",
        "a fault of 0.3 (in any parameter; least visible in b)",
        "not for certain: a fault of 0.5 (in any parameter; least visible in b)",
        "a fault of 0.02",
    ]
    assert caught(replace(verdict, controls=())) == []


def test_terminal_and_summary_say_it(passing, tmp_path):
    verdict = replace(passing.verdict, controls=CONTROLS)
    said = terminal_summary(verdict, tmp_path)
    assert "\nThis audit would have caught, 80% of the time" in said
    assert "\n  a fault of 0.3 (in any parameter; least visible in b)\n" in said
    assert "- a fault of 0.3 (in any parameter; least visible in b)" in summary_markdown(verdict, title="x")
    without = replace(verdict, controls=())
    assert "would have caught" not in terminal_summary(without, tmp_path) + summary_markdown(
        without, title="x"
    )


def test_pictures_show_every_size_and_what_is_tolerated(passing):
    verdict = replace(passing.verdict, controls=CONTROLS)
    (section,) = controls_sections(verdict)
    bias, region, loss = (str(panel.picture) for panel in section.panels)
    assert (bias.count('class="rung"'), bias.count('class="rung caught"')) == (2, 2)
    assert (bias.count('class="least"'), region.count('class="least"')) == (2, 1)
    assert ('class="tolerated"' in bias, 'class="tolerated"' in loss) == (True, False)
    # The dot that is caught lies under the line that says so.
    (line,) = re.findall(r'd="M([\d.]+) [\d.]+v18"', loss)
    assert f'cx="{line}"' in loss
    assert controls_sections(replace(verdict, controls=())) == []
