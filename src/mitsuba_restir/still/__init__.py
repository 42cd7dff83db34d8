"""One picture from independent frames: planned by itself, mixed, rendered to a stated error."""
