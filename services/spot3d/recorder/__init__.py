"""Recordings of messages in MCAP files: written, read, played back, and exported to other viewers."""
