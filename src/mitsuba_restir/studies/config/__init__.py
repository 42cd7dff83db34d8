"""What a study is: an experiment as data, read from TOML, checked and changed."""
