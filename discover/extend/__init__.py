"""Fit again with the effect in the model."""
