"""Log evidences of nested sampling: their errors, and whether these hold."""
