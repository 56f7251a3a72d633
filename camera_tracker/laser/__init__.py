"""The laser distance module of thesis 3.4: two laser dots in the picture of a forward camera."""
