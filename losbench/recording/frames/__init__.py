"""Frames on disk, a file for each format: what a recording reads from."""
