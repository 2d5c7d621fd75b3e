"""Optics: where light goes and how the camera moves."""
