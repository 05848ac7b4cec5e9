"""Checks with S3 servers of other projects on loopback: bin/check-s3."""
