"""Does the name hold on data that did not choose it."""
