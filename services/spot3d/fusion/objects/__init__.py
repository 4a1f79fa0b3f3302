"""The default's way to objects: segments of single keyframes, joined where most views agree."""
