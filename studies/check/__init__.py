"""How often a check is wrong about what the simulator made, and what it sees of what it did not."""
