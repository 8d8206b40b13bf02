"""Calibrations in the forms that other software loads."""
