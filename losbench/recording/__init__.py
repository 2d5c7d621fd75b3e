"""A user's own frames, from the files to a table of angles."""
