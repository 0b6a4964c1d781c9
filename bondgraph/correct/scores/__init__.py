"""Score tests of candidates on a fitted model, for all of the data, in part of it, and with little process noise."""
