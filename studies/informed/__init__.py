"""How often the *informed* gate blocks estimators that lose what the data say, and exact ones, by simulation."""
