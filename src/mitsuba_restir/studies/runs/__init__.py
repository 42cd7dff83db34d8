"""From a study to frames: the scene, the renderers of its variants, and one run of them all."""
