"""What the statistical tests share: scenes, modes, independent runs, references and mutants."""
