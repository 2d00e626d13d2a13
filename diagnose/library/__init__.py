"""The library of faults: what each looks like, and how it is mended in the draws or in the call."""
