"""Read a store: rows, columns, sensors, annotations and the index."""
