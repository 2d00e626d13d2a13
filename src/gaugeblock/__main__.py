"""``python -m gaugeblock``: the same as ``gaugeblock``."""

from gaugeblock.cli import main

if __name__ == "__main__":
    main()
