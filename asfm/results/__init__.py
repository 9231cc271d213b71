"""The results folder: every file that a run writes, written and read."""
