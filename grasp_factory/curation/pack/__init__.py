"""Pack a store: the same rows in larger blocks, so in fewer files."""

from grasp_factory.curation.pack.packing import Packed, pack_part, pack_store

__all__ = ["Packed", "pack_part", "pack_store"]
