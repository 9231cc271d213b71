"""Readers: one file a format, and the writer of the native folder."""
