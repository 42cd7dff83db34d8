"""Mutations of a pixel's path by a Markov chain: what it proposes, accepts, and when it runs."""
