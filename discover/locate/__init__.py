"""Where simulation and data disagree.

Array functions of counts, expected counts at the fitted parameters and their Jacobian: `residuals` of single
channels, a scan over `windows`, cumulative `quantiles`, residuals of many sources by `stacking`, and in which
of two `frames` they lie still. `fitted` holds what all of them rest on.
"""

from gaugeblock.discover.locate.fitted import FittedCounts, normal_score
from gaugeblock.discover.locate.frames import Fixed, Frames, compare_frames
from gaugeblock.discover.locate.quantiles import CumulativeCounts, cumulative_counts
from gaugeblock.discover.locate.residuals import channel_scores, randomised_scores
from gaugeblock.discover.locate.stacking import StackedExcess, stack_excess, stacking_bins
from gaugeblock.discover.locate.windows import WindowScan, scan_windows

__all__ = [
    "CumulativeCounts",
    "FittedCounts",
    "Fixed",
    "Frames",
    "StackedExcess",
    "WindowScan",
    "channel_scores",
    "compare_frames",
    "cumulative_counts",
    "normal_score",
    "randomised_scores",
    "scan_windows",
    "stack_excess",
    "stacking_bins",
]
