"""Benchmarks of speed and accuracy: ``python -m tools.benchmark``."""
