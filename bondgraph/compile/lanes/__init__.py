"""Programs printed as loops over lanes and compiled to vector instructions."""
