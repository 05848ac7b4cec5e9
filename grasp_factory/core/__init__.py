"""Shared records and vocabulary: geometry, cameras, the config, the schema of the store."""
