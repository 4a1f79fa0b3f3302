"""Source stage: a recording or the built-in scene becomes frames, colour registered with depth."""
