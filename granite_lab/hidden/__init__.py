"""Virtual trials whose missing effect is sealed: an implementation that shares no code with the model."""
