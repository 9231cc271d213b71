"""HoloOcean, NeuSIS and AONeuS pickles."""
