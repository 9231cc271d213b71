"""Fuzz targets: a valid file of each kind that a command line can name, and the reader that opens it."""

from tools.fuzz.mesh_seeds import MESH_TARGETS
from tools.fuzz.native_seeds import NATIVE_TARGETS
from tools.fuzz.recording_seeds import RECORDING_TARGETS
from tools.fuzz.results_seeds import RESULTS_TARGETS

TARGETS = {**NATIVE_TARGETS, **RECORDING_TARGETS, **MESH_TARGETS, **RESULTS_TARGETS}
"""Targets by the name on the command line."""
