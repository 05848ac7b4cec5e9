"""From (config, seed, index) to the complete recipe of an episode."""
