"""Imaging: pixels."""
