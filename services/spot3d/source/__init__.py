"""Source stage: turns a recording or the built-in scene into frames with colour registered to depth."""
