"""What is below all rooms: errors, random streams, files written atomically, digests, settings."""
