"""Random numbers: counter-based primary-sample streams."""
