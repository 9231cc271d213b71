"""Recordings of the HoloOcean simulator, as pickles."""
