"""The reconstruction pipeline: the only code that imports both front-end and back-end."""

from asfm.pipeline.reconstruction import Run, reconstruct

__all__ = ["Run", "reconstruct"]
