"""The gain study: a shift of the gain that no published check saw, put to shared scores over catalogues."""
