"""Whether two codes compute the same likelihood."""
