"""The paper's way to objects: planes of random triples, and clusters of the map's points by density."""
