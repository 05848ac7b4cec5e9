"""Draw the complete recipe of an episode from (config, seed, index)."""
