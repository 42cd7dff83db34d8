"""How path trees grow: directions and roulette by what earlier frames found, and its learning."""
