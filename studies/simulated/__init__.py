"""What discovery finds on the epidemic by simulations alone: information, names, amplitudes."""
