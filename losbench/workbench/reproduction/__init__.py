"""Reproduction: every notebook run, every figure, table, page and verdict gathered."""
