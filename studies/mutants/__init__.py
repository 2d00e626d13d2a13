"""Small wrong changes to lines that compute, drawn by a seed, and whether a test notices each."""
