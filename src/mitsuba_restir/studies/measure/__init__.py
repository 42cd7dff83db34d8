"""From finished runs to rows of numbers."""
