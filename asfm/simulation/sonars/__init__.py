"""Sonar parameters and presets."""
