"""Whose paths a pixel reuses: a strategy a file, and which surfaces are alike."""
