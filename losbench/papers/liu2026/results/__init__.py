"""The numbers behind every figure and table of liu2026."""
