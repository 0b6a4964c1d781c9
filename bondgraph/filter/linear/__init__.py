"""How the whitened innovations of a filter respond to small changes: of the model, its noise levels, its steps."""
