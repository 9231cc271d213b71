"""The native sequence folder."""
