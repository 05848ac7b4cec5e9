"""Record a session: all devices at once into one MCAP file, with alarms while it records."""
