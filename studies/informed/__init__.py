"""How often the *informed* gate blocks estimators that lose what data say, and exact ones, by simulation."""
