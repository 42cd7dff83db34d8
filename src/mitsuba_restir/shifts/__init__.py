"""Shift mappings: pure maps between the path spaces of two pixels, with their Jacobians."""
