"""What was on the wire, kept in MCAP files: written, read, put back on the wire, and exported to other viewers."""
