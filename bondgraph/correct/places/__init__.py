"""Where something is missing: unknown efforts and flows at every place, their pictures, and what sensors tell apart."""
