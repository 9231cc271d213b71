"""Acoustic structure from motion for forward-looking imaging sonar."""

from importlib.metadata import version

__version__ = version("asfm")
