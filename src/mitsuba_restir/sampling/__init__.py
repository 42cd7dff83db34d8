"""Random numbers: counter-based primary-sample streams, blue-noise masks, dithered streams."""
