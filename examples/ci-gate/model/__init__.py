"""What this repository is about: a simulator of decay counts. The flow is trained from `train.toml`."""
