"""One parameter at a time: where truths rank among draws, how far they lie from them, what intervals hold."""
