"""How many trials it takes, and what so many can show."""
