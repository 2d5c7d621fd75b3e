"""Pointing: angles."""
