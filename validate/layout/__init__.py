"""Are the draws' columns what they are taken for? In another order, unit or on another scale, say which."""
