"""Estimation: numbers only."""
