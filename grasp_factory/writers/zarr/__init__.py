"""The default writer: a Zarr store, one shard of each array per block."""
