"""Does the name hold on data held out of its fits."""
