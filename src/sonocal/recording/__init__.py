"""Recordings: images and the poses of tracked tools."""
