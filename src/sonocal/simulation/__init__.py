"""Simulated sightings and recordings with known truth."""
