"""What a field engineer runs first: what is wrong here, and what to do about it."""
