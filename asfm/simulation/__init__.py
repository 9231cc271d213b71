"""Simulated sequences with exact truth."""
