"""Similarity registration of points and lines; knows no ultrasound."""
