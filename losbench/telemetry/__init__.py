"""Telemetry: your quaternions, with their drift taken out."""
