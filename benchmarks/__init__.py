"""Measurements of speed and accuracy; run as modules, such as ``python -m benchmarks.main_path``."""
