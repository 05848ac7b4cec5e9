"""Define the shared records and words: geometry, cameras, config, schema of the store."""
