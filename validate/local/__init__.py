"""Not only on average: calibration within regions of the data, and around one observation."""
