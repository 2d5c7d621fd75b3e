"""From heat to line of sight: one brick mesh for temperatures and displacements, an exact map to
the spots.
"""
