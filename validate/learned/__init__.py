"""What a classifier learns to tell apart: truths from draws, and one sample from another."""
