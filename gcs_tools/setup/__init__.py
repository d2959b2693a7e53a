"""``clearway init``: a folder with a set of files that fit together."""
