"""Where simulation and data disagree."""
