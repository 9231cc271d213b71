"""Diagnostics of a solution: connectivity and observability."""
