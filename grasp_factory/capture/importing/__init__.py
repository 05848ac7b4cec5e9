"""Import of recorded sessions into stores: cutting, labels, and real episodes."""
