"""The flow may be merged if its posteriors mean what they say."""

from pathlib import Path

import pytest
from model.decay import Decay

TRAINED = Path(__file__).resolve().parent.parent / "trained"


# The validators that take seconds; the audit in the workflow runs all of them.
@pytest.mark.calibration(validators=("draws", "sbc", "coverage", "importance"))
def test_the_flow_is_calibrated(calibration_gate):
    """PASS, or the test fails and says what is wrong."""
    calibration_gate({"name": "npe", "path": str(TRAINED)}, Decay())
