"""Calibrate a tracked ultrasound probe with a tracked needle."""

__version__ = "0.1.0"
