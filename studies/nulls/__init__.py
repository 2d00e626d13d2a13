"""Spectra in which nothing is hidden, and how often something is found in them all the same."""
