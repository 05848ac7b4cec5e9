"""How bytes come from devices: serial lines, UDP, packets with checksums, counts that wrap."""
