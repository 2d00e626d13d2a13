"""The policies that ship with gaugeblock, as TOML."""
