"""The scalar oracle: the published lattice, link by link in double precision, written from the reference."""
