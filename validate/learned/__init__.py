"""What a classifier learns to tell apart: truths from draws, and one sample from another."""

from gaugeblock.validate.learned.observations import local_c2st
from gaugeblock.validate.learned.two_sample import classifier_two_sample

__all__ = ["classifier_two_sample", "local_c2st"]
