"""remeshing (see docs/design.md)."""
