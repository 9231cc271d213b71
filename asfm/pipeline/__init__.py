"""The reconstruction pipeline: the only code that knows both front-end and back-end."""
