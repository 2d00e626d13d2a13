"""Where simulation and data disagree.

Array functions of counts, expected counts at the fitted parameters and their Jacobian: `residuals` of single
channels, a scan over `windows`, cumulative `quantiles`, residuals of many sources by `stacking`, and in which
of two `frames` they lie still. `fitted` holds what all of them rest on.
"""

from gaugeblock.discovery.locate.fitted import FittedCounts, normal_score
from gaugeblock.discovery.locate.frames import Fixed, Frames, compare_frames
from gaugeblock.discovery.locate.quantiles import CumulativeCounts, cumulative_counts
from gaugeblock.discovery.locate.residuals import channel_scores
from gaugeblock.discovery.locate.stacking import StackedExcess, stack_excess, stacking_bins
from gaugeblock.discovery.locate.windows import WindowScan, scan_windows

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
    "scan_windows",
    "stack_excess",
    "stacking_bins",
]
