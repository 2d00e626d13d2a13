"""Does the estimator use its data? Challengers learn from them what it missed, and tell truths from draws."""
