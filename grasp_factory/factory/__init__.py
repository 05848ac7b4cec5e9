"""Making stores: which blocks are missing, who makes them, what came of it."""
