"""Which effect of the library explains it, and which others the data cannot tell from it."""
