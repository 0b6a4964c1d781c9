"""Search: which candidates are refitted, from where, and when that ends."""
