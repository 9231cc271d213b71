"""Mutation fuzzing of the readers."""
