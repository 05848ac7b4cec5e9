"""Stores in object storage: addresses, clients, bounded reads, and what is put once."""
