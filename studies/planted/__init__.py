"""Real counts with a fault planted in them, and real counts without."""
