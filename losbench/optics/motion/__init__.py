"""Motion of the line of sight: vibration, what a gyro reads of it, and the path that both give."""
