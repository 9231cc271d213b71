"""Report of a study: figures, tables and one HTML page."""
