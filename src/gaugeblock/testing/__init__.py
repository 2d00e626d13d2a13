"""The gate inside pytest: a plugin, its fixture, its settings and what it says."""
