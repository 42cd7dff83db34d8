"""Guided candidates: where earlier frames found light, by cells of space, and its learning."""
