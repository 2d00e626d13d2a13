"""Does measured data look like simulated data? For arrays of both; discovery builds on these."""
