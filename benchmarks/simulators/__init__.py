"""Scans with known truth, simulated with no word in common with the code under test; tests use them, too."""
