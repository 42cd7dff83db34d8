"""What is kept: a study's folder, finished runs in it, and references for all studies."""
