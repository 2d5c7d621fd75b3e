"""The numbers behind every figure and table of ren2023."""
